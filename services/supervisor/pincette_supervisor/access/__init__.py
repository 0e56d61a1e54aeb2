"""Access rights: keys, sessions, limits, and the audit log."""
