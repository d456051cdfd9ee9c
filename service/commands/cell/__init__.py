"""Commands for a cell: examine devices, choose poses and places, measure, rescue a record."""
