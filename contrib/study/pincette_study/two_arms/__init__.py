"""Two driven arms on one part: random pairs, taught and simulated, under the law of two arms."""
