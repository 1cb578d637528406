"""T265 tracking camera: backends, frames, driver logic."""
