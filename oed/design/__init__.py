"""Relaxed designs: constraints, the convex problems, and certificates."""
