"""Channels and tasks of NI-DAQmx."""
