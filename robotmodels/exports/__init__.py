"""The model taken out: robot files, MJCF, URDF, state space, modes."""
