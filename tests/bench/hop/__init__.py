"""Cost of a tick for each single service, without bus, threads and instruments."""
