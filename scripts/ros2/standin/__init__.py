"""A small `ros2` command for installations of ROS 2 that come without one.

Syntax, output and exit codes are those of Jazzy's ros2cli; there is no daemon and no plugin.
"""
