"""Which springs a robot has: score tests of absent ones, their choice, what it can tell."""
