"""Kinds of job: one folder each, registered in ``pyproject.toml``."""
