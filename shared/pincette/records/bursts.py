"""What a sensor acquired from its own buffer, joined to one series."""

from collections.abc import Iterable
from dataclasses import dataclass

from pincette.messages import Burst, Message


@dataclass(frozen=True, slots=True)
class Joined:
    """N samples, one each 1/``rate_hz``: position in µm and drive in V."""

    rate_hz: float
    x_um: list[float]
    drive_V: list[float]


def joined(messages: Iterable[Message]) -> Joined | None:
    """Join the bursts of one epoch; None without one.

    Raises
    ------
    ValueError
        Where one between them never came, or was out of the sensor's range.
    """
    bursts = {message.seq: message for message in messages if isinstance(message, Burst)}
    if not bursts:
        return None
    for seq in range(min(bursts), max(bursts) + 1):
        if seq not in bursts:
            raise ValueError(f"the acquisition of sample {seq} never came")
        if not bursts[seq].valid:
            raise ValueError(f"the acquisition of sample {seq} was out of the sensor's range")
    ordered = [bursts[seq] for seq in sorted(bursts)]
    return Joined(
        ordered[0].rate_hz,
        [value for burst in ordered for value in burst.x_um],
        [value for burst in ordered for value in burst.drive_V],
    )
