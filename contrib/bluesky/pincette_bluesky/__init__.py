"""A rig as a device of bluesky: ``Gripper(url)``, an ophyd-async device over the client of REST."""

from pincette_bluesky.gripper import Gripper

__all__ = ["Gripper"]
