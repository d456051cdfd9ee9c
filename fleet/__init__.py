"""Many robots: the store of what is known of them, and what feeds and asks it (docs/decisions/0078)."""
