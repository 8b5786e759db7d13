"""What the terminal says, and the same as JSON."""
