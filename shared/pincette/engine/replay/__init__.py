"""Replay of recorded epochs through one service alone."""
