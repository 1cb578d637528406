"""The page of the console: what it shows, drawn by viser."""
