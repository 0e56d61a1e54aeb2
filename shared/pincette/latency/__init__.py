"""How late things are: histograms of durations, and the period that a machine supports; pure."""
