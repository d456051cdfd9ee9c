"""Robots that a person drives, and instruments that a person reads: the person types the numbers."""
