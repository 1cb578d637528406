"""Propulsion unit: fans, battery, mixer, MAVLink autopilot, remote control."""
