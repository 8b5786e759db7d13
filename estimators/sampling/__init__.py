"""Posteriors and profile likelihoods of a fit."""
