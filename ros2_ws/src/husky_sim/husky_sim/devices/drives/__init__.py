"""Emulated Gold Twitter drives and their motors on a simulated EtherCAT segment."""
