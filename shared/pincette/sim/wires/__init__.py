"""Endpoints at which a simulated instrument can be reached."""
