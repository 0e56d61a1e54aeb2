"""Places at which a simulated instrument can be reached."""
