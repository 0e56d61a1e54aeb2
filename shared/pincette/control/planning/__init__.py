"""Planning: references of position and force together, and the programs that carry them."""
