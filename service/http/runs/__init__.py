"""Runs and closed loops: one at a time uses the robot."""
