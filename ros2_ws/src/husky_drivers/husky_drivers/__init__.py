"""Robot's side of the wires: EtherCAT drives (CiA 402), VN-200, T265, D435."""
