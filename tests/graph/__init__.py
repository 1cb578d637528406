"""Tests of the running graph; one that is shared ends with the last of them in a worker."""
