"""Robots that a person drives and instruments that a person reads: what was seen is typed."""
