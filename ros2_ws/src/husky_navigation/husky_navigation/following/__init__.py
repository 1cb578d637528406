"""Following a route: velocities along its legs, and the modes that they are gone in."""
