"""Gripper as a SiLA 2 server: an adapter that uses only ``pincette.client``."""
