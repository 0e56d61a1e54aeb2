"""What a machine can keep: its wake-ups on a grid, its hops over the bus, idle or under load.

What is measured runs in processes of its own, as the programs of a loop do, with the priority and
the settings of the interpreter that those have.
"""
