"""Routes outside the interface: the operator page, its documentation, metrics."""
