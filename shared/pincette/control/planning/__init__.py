"""Planning of position and force references, and of the motion programs that contain them."""
