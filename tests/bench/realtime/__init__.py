"""Loops in real time: how punctual, at which rate, with how many rigs and listeners."""
