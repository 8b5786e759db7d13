"""Uncertainty put to the test: repeated simulations, cross-checks, positions held out."""
