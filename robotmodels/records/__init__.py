"""Periodic runs, measured or simulated, and their files."""
