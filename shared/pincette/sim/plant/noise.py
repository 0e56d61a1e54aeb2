"""Gaussian noise that depends only on (seed, stream, index), not on earlier calls."""

from numpy.random import Generator, Philox

BLOCK = 1024
STREAM = 192
"""First bit of the generator's counter that is used for the stream number."""


class GaussianNoise:
    """Standard normal numbers by index, drawn in blocks from a counter-based generator."""

    def __init__(self, seed: int, stream: int = 0) -> None:
        self._seed = seed
        self._stream = stream
        self._block = -1
        self._values: list[float] = []

    def at(self, index: int) -> float:
        """Return the number with this index ≥ 0; mean 0, variance 1."""
        block, place = divmod(index, BLOCK)
        if block != self._block:
            key = (self._seed % 2**64) | (block % 2**64) << 64
            generator = Generator(Philox(key=key, counter=self._stream << STREAM))
            self._values = generator.standard_normal(BLOCK).tolist()
            self._block = block
        return self._values[place]
