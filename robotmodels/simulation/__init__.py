"""Experiments simulated: MuJoCo, controllers and the noise of the closed loop."""
