"""Cells of a foreign file: its sheets, the table in them, and its notation.

The notation is the way in which numbers, dates and units are written.
"""
