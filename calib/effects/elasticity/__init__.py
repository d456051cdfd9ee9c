"""Effects of the elasticity: what gears, links, bearings and the pedestal yield to loads, and loads not as declared."""
