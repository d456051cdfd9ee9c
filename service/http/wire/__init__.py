"""The messages over HTTP: bodies, headers, paths and problems."""
