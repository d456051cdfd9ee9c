"""The map of columns: which column is what, in which unit and by which convention; written and read as a file."""
