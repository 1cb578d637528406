"""Remote control: SBUS frames, their line and the mapping of sticks."""
