"""A simulated C-Track behind its bridge."""
