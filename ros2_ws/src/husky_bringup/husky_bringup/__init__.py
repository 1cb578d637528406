"""Launch and parameter files, recorder, teleoperation, gateway."""
