"""Emulated VN-200."""
