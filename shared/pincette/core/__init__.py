"""Shared parts of all programs: services as data, topics, messages and their codec, plug-ins."""
