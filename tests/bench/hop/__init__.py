"""What a tick costs each service by itself, without bus, threads and instruments."""
