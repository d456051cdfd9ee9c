"""The map of columns: which column is what, in which unit and by which convention; written to a file and read from it."""
