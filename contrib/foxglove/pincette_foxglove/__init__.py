"""A rig's samples in Foxglove, as they are in a record; never part of the loop."""
