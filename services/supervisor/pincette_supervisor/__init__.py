"""The supervisor: plans, runs and records jobs over REST; never inside the loop."""
