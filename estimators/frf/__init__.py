"""Nonparametric FRFs with the statistics of their errors; records and FRFs as files."""
