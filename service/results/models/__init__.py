"""Results of fits: identification, diagnosis, regression, joint sweeps and predictions."""
