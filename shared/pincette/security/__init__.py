"""Identities on the bus, and their rights."""
