"""Sensors that err in nothing, to tell what a controller does from what sensing does to it."""

from __future__ import annotations

IDEAL_SENSING: dict[str, float] = {
    "imu__gyro_noise_density": 0.0,
    "imu__accel_noise_density": 0.0,
    "imu__gyro_bias": 0.0,
    "imu__accel_bias": 0.0,
    "t265__drift": 0.0,
    "t265__position_noise": 0.0,
    "t265__attitude_noise": 0.0,
    "t265__velocity_noise": 0.0,
    "t265__angular_velocity_noise": 0.0,
    "t265__acceleration_noise": 0.0,
}
"""What VN-200 and T265 have otherwise than their robot's file says, for `load_robot`."""
