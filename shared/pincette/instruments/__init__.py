"""Drivers of real instruments, and the one link they speak over."""
