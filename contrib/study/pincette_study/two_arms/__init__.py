"""Two driven arms on one part: random simulated pairs with identified models, and their law."""
