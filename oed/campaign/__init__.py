"""Identification in steps: visits proposed, records taken back, until accuracies are reached."""

from oed.campaign.campaign import Campaign as Campaign, CampaignStatus as CampaignStatus
from oed.campaign.settings import CampaignSettings as CampaignSettings
from oed.campaign.simulated import simulate_visits as simulate_visits
from oed.campaign.visits import Visit as Visit
