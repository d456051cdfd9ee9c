"""Commands about files: foreign data, streams, robot files, and models for other programs."""
