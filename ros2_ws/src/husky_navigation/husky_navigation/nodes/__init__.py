"""ROS 2 nodes: thin shells that turn messages into calls of the pure part."""
