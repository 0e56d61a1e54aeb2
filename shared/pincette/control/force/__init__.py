"""Contact force: estimation, zeroing and uncertainty."""
