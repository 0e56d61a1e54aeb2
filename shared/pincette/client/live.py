"""Single samples of a rig, each once, from the batches in which they arrive."""

from collections.abc import Iterator
from typing import NamedTuple

from pydantic import ValidationError

from pincette.api.live import LiveBatch
from pincette.client.errors import ForeignAnswerError

ON_THE_WAY_S = 0.5
"""Largest age of the newest samples in the first batch, in s; a batch waits for the messages of its
samples.
"""


class LiveSample(NamedTuple):
    """One sample of a rig; unknown values are None."""

    epoch: int
    """Random number of the arming. All samples between one arming and the next have the same
    number.
    """
    seq: int
    t_s: float
    """Time since the arming, in s."""
    playing: bool
    """True if a motion program plays; otherwise only position and voltage are known."""
    phase: str
    """Name of the phase; empty while no program plays."""
    x_um: float | None
    x_r_um: float | None
    force_mN: float | None
    force_r_mN: float | None
    force_uncertainty_mN: float | None
    voltage_V: float | None
    sliding_um: float | None
    second_x_um: float | None = None
    second_force_mN: float | None = None
    second_voltage_V: float | None = None
    place_um: float | None = None
    """Place q of the part that two arms hold, in µm; None on a rig with one arm."""
    place_r_um: float | None = None


class LiveBookmark:
    """Position in the stream of samples across lost connections; each new connection repeats the
    last minute.
    """

    def __init__(self, path: str, past_s: float) -> None:
        self.path = path
        self._past_s = past_s
        self._epoch, self._seq = 0, -1
        self._from_s: float | None = None

    def read(self, data: str) -> Iterator[LiveSample]:
        """Yield the samples of an event that were not read before; raises ForeignAnswerError."""
        try:
            batch = LiveBatch.model_validate_json(data, extra="ignore")
        except ValidationError as error:
            raise ForeignAnswerError(f"{self.path}: {data[:200]!r} is not a batch") from error
        if self._from_s is None:
            self._from_s = batch.now_s - self._past_s - ON_THE_WAY_S
        for place, (seq, at_s) in enumerate(zip(batch.seq, batch.at_s, strict=True)):
            seen = batch.epoch == self._epoch and seq <= self._seq
            if at_s >= self._from_s and not seen:
                self._epoch, self._seq, self._from_s = batch.epoch, seq, at_s
                yield _sample(batch, place)


def _sample(batch: LiveBatch, place: int) -> LiveSample:
    return LiveSample(
        epoch=batch.epoch,
        seq=batch.seq[place],
        t_s=batch.t_s[place],
        playing=batch.playing,
        phase=batch.phase,
        x_um=batch.x_um[place],
        x_r_um=batch.x_r_um[place],
        force_mN=batch.force_mN[place],
        force_r_mN=batch.force_r_mN[place],
        force_uncertainty_mN=batch.force_uncertainty_mN[place],
        voltage_V=batch.voltage_V[place],
        sliding_um=batch.sliding_um[place],
        **_of_second(batch, place),
    )


def _of_second(batch: LiveBatch, place: int) -> dict[str, float | None]:
    second = batch.second
    if second is None:
        return {}
    return {
        "second_x_um": second.x_um[place],
        "second_force_mN": second.force_mN[place],
        "second_voltage_V": second.voltage_V[place],
        "place_um": second.place_um[place],
        "place_r_um": second.place_r_um[place],
    }
