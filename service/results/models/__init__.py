"""Results of fits: identification, diagnosis, regression and sweeps, as documents and as rows."""
