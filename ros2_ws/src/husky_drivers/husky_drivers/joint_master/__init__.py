"""What a master of joints is, whichever wire they are on."""
