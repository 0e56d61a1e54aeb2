"""What Prometheus is told of the rigs: all of it from what their programs tell anyway."""
