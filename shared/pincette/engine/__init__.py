"""The runtime of services: joining inputs, clocks, processes."""
