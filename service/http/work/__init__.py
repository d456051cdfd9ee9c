"""The work of the service: stored documents, and computations in separate processes."""
