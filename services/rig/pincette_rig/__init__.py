"""Simulated rig as a program; no other program knows that it is simulated."""
