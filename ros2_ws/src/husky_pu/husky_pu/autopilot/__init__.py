"""Simulated Pixhawk: estimator, control, mixer, fail-safes and its MAVLink server."""
