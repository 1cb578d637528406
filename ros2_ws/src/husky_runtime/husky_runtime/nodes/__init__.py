"""What every node shares: executor, quality of service, parameters, diagnostics, start and end."""
