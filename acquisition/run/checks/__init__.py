"""Checks beside the readings: warm-up, nests, the target seen, the computer's calendar."""
