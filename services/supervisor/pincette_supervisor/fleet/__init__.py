"""The rigs of a supervisor: how they are found, opened and shown over REST."""
