"""Figures: each function returns a drawing that a page shows as SVG."""
