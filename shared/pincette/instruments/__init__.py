"""Drivers of real instruments, and the link that they share."""
