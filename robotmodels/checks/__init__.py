"""What a person should know of a robot file."""
