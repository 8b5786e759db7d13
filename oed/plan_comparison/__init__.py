"""Plans compared in simulated experiments."""
