"""Map of the ground around the robot, from depth images and footholds."""
