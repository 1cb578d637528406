"""What talks to hardware: EtherCAT drives (CiA 402) and the VN-200."""
