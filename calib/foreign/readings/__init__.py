"""The map applied: readings of one file or of two that belong together, and the table of a data set."""
