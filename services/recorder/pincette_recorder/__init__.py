"""Recorder program: stores every sample of every job; it is never part of the loop."""
