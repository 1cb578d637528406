"""Serial lines and pseudo-terminals."""
