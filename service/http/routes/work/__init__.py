"""Routes of the work in worker processes: jobs, results, and the files of results."""
