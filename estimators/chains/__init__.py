"""Coupled chains by inverse eigenvalue theory, [HBH]: modes, masses, springs, couplings."""
