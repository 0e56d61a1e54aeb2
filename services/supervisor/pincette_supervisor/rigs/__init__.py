"""What is known of a rig, and what stops it."""
