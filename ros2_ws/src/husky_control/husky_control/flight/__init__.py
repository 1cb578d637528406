"""Flight on the fans."""
