"""Universal Robots, CB3 and e-Series (`drivers.ur.arm`)."""
