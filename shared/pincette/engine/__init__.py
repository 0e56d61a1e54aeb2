"""Services at work: joining inputs, clocks, processes."""
