"""Robots that a person drives, and instruments that a person reads by typing the numbers."""
