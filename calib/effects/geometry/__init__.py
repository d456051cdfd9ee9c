"""Effects of the geometry: zeros, axes, the tool on the flange, and steps of these between two readings."""
