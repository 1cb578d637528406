"""Propulsion unit: companion's bridge, simulated Pixhawk, radio."""

VERSION = (0, 1, 0)
"""Of this package, as in package.xml: major, minor, patch."""
