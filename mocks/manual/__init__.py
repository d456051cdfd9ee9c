"""The simulated person at a robot without a driver and at an instrument without one."""
