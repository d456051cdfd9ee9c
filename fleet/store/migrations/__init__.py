"""The history of the tables of a store: one file a step in `versions`, which never changes once a store has seen it."""
