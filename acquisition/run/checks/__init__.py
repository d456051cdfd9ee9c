"""Checks in addition to the readings: warm-up, nests, measured target, calendar."""
