"""The supervisor: plans, runs and records jobs over REST; it is never part of the loop."""
