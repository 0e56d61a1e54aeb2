"""The gripper as a SiLA 2 server: an adapter that stands on ``pincette.client`` alone."""
