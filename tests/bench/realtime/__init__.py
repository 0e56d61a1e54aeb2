"""Loops in real time: punctuality by rate, number of rigs and number of subscribers."""
