"""Shared code of several kinds of tests."""
