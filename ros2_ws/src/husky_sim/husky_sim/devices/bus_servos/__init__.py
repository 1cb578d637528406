"""Far side of the servo bus: emulated DYNAMIXEL servos and their motors."""
