"""Numbers of a run, each from its recording."""
