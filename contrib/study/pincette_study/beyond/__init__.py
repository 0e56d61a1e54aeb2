"""Results beyond the paper on one arm: at its own period, and at 1 ms."""
