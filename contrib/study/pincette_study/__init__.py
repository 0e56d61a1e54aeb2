"""The paper's experiments on a simulated rig, and the comparison with its numbers."""
