"""Modes of the controller and the table of their transitions."""
