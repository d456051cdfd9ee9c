"""Driver of Acme's controllers, its simulator and its bench."""
