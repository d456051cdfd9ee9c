"""Routes of what a worker computes: jobs, results, files made of them."""
