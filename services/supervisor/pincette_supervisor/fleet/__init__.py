"""The rigs that a supervisor serves: how they are found, opened and shown over REST."""
