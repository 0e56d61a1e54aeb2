"""Randomly drawn rigs and their true values."""
