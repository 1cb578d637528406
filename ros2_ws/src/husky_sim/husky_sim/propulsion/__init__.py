"""Physics of the propulsion unit: fans, speed controllers, battery."""
