"""The paper's experiments on a simulated rig, and how its numbers compare."""
