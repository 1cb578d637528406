"""Parts of the node `foxglove_gateway`: topics, services, and what clients publish."""
