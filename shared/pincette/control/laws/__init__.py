"""The laws: from references, position and force to the voltage."""
