"""The linear model of a robot or of chains, and what follows from it."""
