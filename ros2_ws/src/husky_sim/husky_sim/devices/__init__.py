"""Far sides of the wires: emulated devices."""
