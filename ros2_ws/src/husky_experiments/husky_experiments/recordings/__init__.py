"""Recordings of runs, read back as arrays."""
