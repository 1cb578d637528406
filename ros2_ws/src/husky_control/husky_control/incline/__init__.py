"""Climbing with the fans (WAIR): statics, thrust and the walk on an incline."""
