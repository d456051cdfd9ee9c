"""Readings of one file, or of two that belong together, from a map, as a data set's table."""
