"""Studies of visits: what to run within minutes, or until accuracies are reached."""
