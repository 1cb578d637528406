"""EtherCAT frames in front of the simulated drives: slave controllers, mailboxes, a raw socket."""
