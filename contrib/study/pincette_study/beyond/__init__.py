"""Results beyond the paper with one arm: at the paper's period, and at 1 ms."""
