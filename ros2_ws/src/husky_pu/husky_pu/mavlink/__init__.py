"""MAVLink on both sides of the wire: dialect, frames, axes."""
