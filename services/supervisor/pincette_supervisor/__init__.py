"""The supervisor: plans, runs and records jobs over REST; never inside the loop."""

from pincette_supervisor.program import run as PROGRAM

__all__ = ["PROGRAM"]
