"""Metrics for Prometheus, from what the programs publish anyway."""
