"""Estimation of the body's state and of contacts."""
