"""Faults and hands at the bench, by order."""
