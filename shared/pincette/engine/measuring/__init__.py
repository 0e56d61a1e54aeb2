"""Timing of a machine: its wake-ups on a grid and its hops over the bus, idle or loaded.

What is measured runs in processes of its own, as the programs of a loop do, with the priority and
the settings of the interpreter that those have.
"""
