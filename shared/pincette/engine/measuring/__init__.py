"""Timing of a machine: its wake-ups on a grid and its hops over the bus, idle or loaded.

Each measurement runs in separate processes, with the priority and the interpreter settings that
the programs of a loop have.
"""
