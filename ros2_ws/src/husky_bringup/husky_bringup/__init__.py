"""Launch file, parameter files, recorder, teleoperation, experiments."""
