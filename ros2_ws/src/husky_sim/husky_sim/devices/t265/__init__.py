"""Emulated T265."""
