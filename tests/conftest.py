"""Plug-ins of all tests: which tests a session runs, and which failures it reruns."""

pytest_plugins = ["tests.support.selection", "tests.support.reruns"]
