"""The sensor: owns the sampling clock and numbers the samples."""

from pincette_sensor.step import SERVICE

__all__ = ["SERVICE"]
