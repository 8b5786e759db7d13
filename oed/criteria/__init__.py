"""What a design maximises."""
