"""Rig as a device of bluesky: ``Gripper(url)``, an ophyd-async device over the REST client."""

from pincette_bluesky.gripper import Gripper

__all__ = ["Gripper"]
