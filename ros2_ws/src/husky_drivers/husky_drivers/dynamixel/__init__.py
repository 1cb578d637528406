"""Robot's side of a bus of DYNAMIXEL servos, protocol 2.0."""
