"""A simulated FARO ION behind its bridge."""
