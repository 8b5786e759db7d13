"""Whole plans: how many experiments go where, in which order, and what comes next."""
