"""Alarms: what is wrong with a rig, and since when."""
