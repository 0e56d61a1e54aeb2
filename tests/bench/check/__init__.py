"""Decide whether a measured ratio is worse than its noise explains."""
