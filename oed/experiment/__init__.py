"""From a plan to signals and back: multisines, limits, files, simulated and measured data."""
