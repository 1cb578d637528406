"""What decides: kinematics, gaits, estimator, safety, modes; the low-level controller."""
