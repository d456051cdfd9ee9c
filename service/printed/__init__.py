"""Output on a terminal: tables, progress, questions."""
