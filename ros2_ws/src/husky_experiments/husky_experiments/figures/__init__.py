"""Figures and videos of a run, each from its recording."""
