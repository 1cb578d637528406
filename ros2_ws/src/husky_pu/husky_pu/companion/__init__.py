"""Companion computer's side of MAVLink: what pixhawk_bridge does."""
