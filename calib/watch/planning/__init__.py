"""Planning of a watch: poses, sides of approach, number of readings, detectable changes."""
