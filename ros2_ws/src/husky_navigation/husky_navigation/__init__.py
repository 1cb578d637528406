"""Map of the ground around the robot, and where the robot is in it."""
