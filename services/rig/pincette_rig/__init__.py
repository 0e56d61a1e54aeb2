"""The simulated rig as a program; nothing else knows that it is simulated."""
