"""Kinds of job, registered in ``pyproject.toml``; requests are separate from their planning."""
