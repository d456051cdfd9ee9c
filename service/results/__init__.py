"""Results as JSON and for reports: no route, no command."""
