"""Tests of uncertainty: repeated simulations, cross-checks, held-out positions."""
