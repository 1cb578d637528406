"""What decides: modes, gaits, estimation, inclines, flight, planning."""
