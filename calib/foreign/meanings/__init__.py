"""Meaning of columns, from names, units and numbers; unclear cases become questions."""
