"""The cells of a foreign file: its sheets, the table in them, and how its numbers, dates and units are written."""
