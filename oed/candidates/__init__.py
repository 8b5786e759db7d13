"""Where the robot could be excited: sources of candidate positions, and what is in the way."""
