"""Drivers of real instruments, and the line that they share."""
