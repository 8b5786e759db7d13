"""A robot that is simulated: controllers, closed loops, and all that spoils measured FRFs."""
