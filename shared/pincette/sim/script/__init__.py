"""Scripted faults and manual actions on a simulated bench."""
