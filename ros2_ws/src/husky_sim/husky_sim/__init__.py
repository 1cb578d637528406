"""The world on the far side of the wires: MuJoCo plant, drives, IMU emulator."""
