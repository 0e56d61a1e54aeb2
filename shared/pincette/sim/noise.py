"""Gaussian noise that depends on (seed, index) alone, whatever was asked before."""

from numpy.random import Generator, Philox

BLOCK = 1024


class GaussianNoise:
    """Standard normal numbers by index, drawn a block at a time from a counter-based generator."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._block = -1
        self._values: list[float] = []

    def at(self, index: int) -> float:
        """Return the number with this index, 0 or above; mean 0, variance 1."""
        block, place = divmod(index, BLOCK)
        if block != self._block:
            key = (self._seed % 2**64) | (block % 2**64) << 64
            self._values = Generator(Philox(key=key)).standard_normal(BLOCK).tolist()
            self._block = block
        return self._values[place]
