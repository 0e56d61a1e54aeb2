"""The arm: its equation of motion, and its mode from sample to sample."""
