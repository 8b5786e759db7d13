"""Relaxed designs: criteria, constraints, the convex problems, and certificates."""
