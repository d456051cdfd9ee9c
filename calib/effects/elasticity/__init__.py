"""Effects of elasticity: gears, links, bearings and the pedestal deflect under loads; undeclared loads."""
