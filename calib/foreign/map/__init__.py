"""Map of columns: the quantity, unit and convention of each, written and read as a file."""
