"""From a plan to signals: multisines, limits, moves, plan files, simulated experiments."""
