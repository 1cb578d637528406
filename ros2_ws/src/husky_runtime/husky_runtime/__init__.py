"""What nodes stand on: graph, executor, lockstep, clocks, ports."""
