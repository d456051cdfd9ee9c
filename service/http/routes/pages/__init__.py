"""Routes beside the interface: the operator page, its documentation, metrics."""
