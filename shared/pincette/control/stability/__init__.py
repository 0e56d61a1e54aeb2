"""Stability before motion: the loop as it runs, its worst case, and a search for gains."""
