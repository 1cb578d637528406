"""VN-200 inertial sensor: protocol, session, driver logic."""
