"""Kinds of job, registered in ``pyproject.toml``; requests are apart from what plans them."""
