"""Chains with dampers, and the whole way from records to chains."""
