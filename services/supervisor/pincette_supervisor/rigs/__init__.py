"""State of a rig, and what stops it."""
