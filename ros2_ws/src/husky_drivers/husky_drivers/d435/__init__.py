"""RealSense D435 depth camera: backends, frames, driver logic."""
