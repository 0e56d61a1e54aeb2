"""The controller: plays a program of segments with a law and guards."""

from pincette_controller.step import SERVICE

__all__ = ["SERVICE"]
