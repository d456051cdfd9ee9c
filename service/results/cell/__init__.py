"""Results about a cell: its plans, its examined devices, and the closed loop."""
