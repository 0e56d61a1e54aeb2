"""Plug-ins of all tests: which tests a session runs, and which failures it reruns."""

from hypothesis import settings

pytest_plugins = ["tests.support.selection", "tests.support.reruns"]

# A busy machine may need any time for one example.
settings.register_profile("without deadline", deadline=None)
settings.load_profile("without deadline")
