"""Gravity, for the world and for everybody in it."""

GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s^2] (ISO 80000-3)."""
