"""Planning of references of position and force, and of the motion programs that carry them."""
