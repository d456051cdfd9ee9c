"""Results of files that were read: foreign files converted, two streams aligned."""
