"""Histograms of durations, and the control period that a machine supports; pure."""
