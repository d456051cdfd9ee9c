"""How the tables of a store came to be: one file a step in `versions`, which never changes once a store has seen it."""
