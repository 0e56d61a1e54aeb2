"""The actuator: last line of defence between the controller and the arm."""

from pincette_actuator.step import SERVICE

__all__ = ["SERVICE"]
