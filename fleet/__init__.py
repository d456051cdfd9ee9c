"""Many robots: their store, and what writes to it and reads from it (docs/decisions/0078)."""
