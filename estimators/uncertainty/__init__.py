"""How far to trust a fit: Theorem 1, posteriors, profiles, repeated experiments, side by side."""
