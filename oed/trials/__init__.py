"""Plans tried in simulated experiments: rivals of an optimal plan, and what comes out of each."""
