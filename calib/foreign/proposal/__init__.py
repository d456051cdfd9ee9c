"""The proposal of a map for files that nobody has seen before, with what the nominal robot says of it."""
