"""Information matrices of candidates, in memory or in a file."""
