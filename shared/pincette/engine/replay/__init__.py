"""Recorded epochs through one service alone."""
