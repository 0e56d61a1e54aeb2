"""Simulated instruments as seen from their lines: tables of commands, without I/O."""
