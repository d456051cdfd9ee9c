"""Robot and instrument as a run uses them: connected, at rest, recorded."""
