"""Faults and manual actions on a simulated bench, by script."""
