"""What the robot is: numbers, URDF, MuJoCo model, looks."""
