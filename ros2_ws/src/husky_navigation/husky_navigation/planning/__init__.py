"""The cheapest way over the ground that was seen, by measured costs of walking and climbing."""
