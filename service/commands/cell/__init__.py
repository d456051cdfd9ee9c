"""Commands about a cell: examine its devices, choose poses and places, measure, rescue a record."""
