"""Two driven arms on one part: random pairs, taught, simulated, under the law of two arms."""
