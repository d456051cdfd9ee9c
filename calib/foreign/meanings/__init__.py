"""What the columns of a table mean: by their names, the row of units and the numbers; what is open is a question."""
