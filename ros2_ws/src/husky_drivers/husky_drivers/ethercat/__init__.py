"""EtherCAT master of the drives: buses, process data, CiA 402."""
