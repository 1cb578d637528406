"""The robot's numbers, names, models and the names of its ROS graph."""
