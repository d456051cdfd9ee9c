"""The meaning of columns, from their names, the row of units and the numbers; what these leave open is a question."""
