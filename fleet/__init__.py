"""Many robots: their store, its writers and its readers (docs/decisions/0078)."""
