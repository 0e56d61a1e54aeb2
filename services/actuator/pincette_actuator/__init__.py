"""The actuator program: it checks each command against the safety limits before it writes the
voltage."""

from pincette_actuator.step import SERVICE

__all__ = ["SERVICE"]
