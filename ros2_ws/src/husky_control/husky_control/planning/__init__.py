"""Plans: the reduced-order model and its optimisation by collocation."""
