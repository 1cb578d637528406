"""Gaits: tables, footholds, swing, stance and the walk that joins them."""
