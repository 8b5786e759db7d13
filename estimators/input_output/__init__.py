"""Maximum likelihood with noisy inputs and outputs, for any number of runs in a position."""
