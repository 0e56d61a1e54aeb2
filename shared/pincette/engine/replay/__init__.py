"""Replay of recorded epochs through a single service."""
