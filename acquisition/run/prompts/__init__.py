"""Prompts of a run to a person, and the answers."""
