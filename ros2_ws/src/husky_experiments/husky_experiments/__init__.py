"""Experiments through the graph: sessions, metrics, figures, video."""
