"""Measurement of a machine's timing: wake-ups on a grid, and transmission over the bus, with or
without load.

Each measurement runs in separate processes, with the priority and the interpreter settings that
the programs of a loop have.
"""
