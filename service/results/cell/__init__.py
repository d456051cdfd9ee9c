"""Results about a cell: what is planned in it, its devices examined, the closed loop."""
