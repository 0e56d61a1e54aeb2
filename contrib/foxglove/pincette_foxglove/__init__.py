"""Samples of a rig in Foxglove, with the schemas of a record; never part of the loop."""
