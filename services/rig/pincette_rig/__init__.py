"""Simulated rig as a program; the other programs cannot distinguish it from a real rig."""
