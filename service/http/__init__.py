"""HTTP service: the command line's verbs as resources, for cell PCs and the operator page."""
