"""Identification in steps: visits proposed, records taken back, until accuracies are reached."""
