"""The work of the service: documents that are kept, and computations in processes of their own."""
