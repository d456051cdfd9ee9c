"""Runs with a ballbar: checks of lengths, cups as touched, the second stage."""
