"""Effects of the instrument and of what it measures from: its scale, its drift, a base target out of place."""
