"""Simulated world: MuJoCo plant, propulsion, emulated devices."""
