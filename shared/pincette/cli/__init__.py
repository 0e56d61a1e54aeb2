"""The command `pincette`."""
