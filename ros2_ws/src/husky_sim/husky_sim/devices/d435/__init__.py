"""Emulated D435."""
