"""Publish samples of a rig to Foxglove, with the schemas of a record. It is not part of the control
loop.
"""
