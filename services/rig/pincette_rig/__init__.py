"""The simulated rig as a program; nothing else knows that it is simulated."""

from pincette_rig.program import run

PROGRAM = run
