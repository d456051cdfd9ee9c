"""Proposal of a map for unknown files, checked against the nominal robot."""
