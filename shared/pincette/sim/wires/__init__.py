"""Where a simulated instrument can be reached."""
