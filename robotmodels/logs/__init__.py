"""Logs of controllers and recorders, read in pieces, and what a mapping makes of them.

A reader (`text_log`, `array_log`, `uff_log`, those of optional libraries) hands on a `Log`: tables
of named channels, each table with rows of its own, nothing of it converted or understood.
"""
