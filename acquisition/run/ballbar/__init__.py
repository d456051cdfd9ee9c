"""Runs with a ballbar: lengths judged, cups placed as touched, the second stage."""
