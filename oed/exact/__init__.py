"""Whole numbers of experiments."""
