"""Identities on the bus, and their permissions."""
