"""Simulated rig: the plant in simulated time, and the instruments' side of the line."""
