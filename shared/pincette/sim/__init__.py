"""Simulated rig: the plant in simulated time, and its instruments as seen over their lines."""
