"""The tables of a record, made from the messages that its file holds, and what they lack."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from pincette.core.messages import Applied, Burst, Command, Estimate, Message, Position, Telemetry
from pincette.records import folder as files
from pincette.records.columns import columns
from pincette.records.mcap_reading import Recording
from pincette.records.timings import loop_timing


def write_tables(folder: Path, recording: Recording) -> list[str]:
    """Write samples, acquisition and timing; returns what is wrong with them; raises OSError."""
    try:
        period_s = recording.period_s
    except (KeyError, ValueError):
        return ["the record does not say its control period: no table can be made of it"]
    table = columns(recording.messages, period_s)
    files.write_samples(folder / files.SAMPLES, table, recording.about)
    timing = loop_timing(recording.messages)
    if timing is not None:
        files.write_json(folder / files.TIMING, timing.model_dump(exclude={"silent"}))
    try:
        acquired = joined(recording.messages)
    except ValueError as error:
        return [str(error)]
    if acquired is not None:
        about = {**recording.about, "rate_hz": repr(acquired.rate_hz)}
        files.write_burst(folder / files.BURST, acquired.x_um, acquired.drive_V, about)
    return []


@dataclass(frozen=True, slots=True)
class Joined:
    """N samples, one each 1/``rate_hz``: position in µm and drive in V."""

    rate_hz: float
    x_um: list[float]
    drive_V: list[float]


def joined(messages: Iterable[Message]) -> Joined | None:
    """Join the bursts of one epoch; None without one; ValueError where one lacks or is invalid."""
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


def lost(messages: Iterable[Message]) -> dict[str, int]:
    """How many samples of an epoch were sent and never came, by topic, as others prove."""
    # A sample that is derived from another proves that the other was sent: an estimate its
    # position, the telemetry of a playing program its estimate, an answered tick its command, and
    # an estimate the applied voltage that it names.
    came: dict[type[Message], set[int]] = {
        kind: set() for kind in (Position, Estimate, Command, Applied)
    }
    sent: dict[type[Message], set[int]] = {kind: set() for kind in came}
    for message in messages:
        match message:
            case Estimate():
                sent[Position].add(message.seq)
                sent[Applied].add(message.applied_seq)
            case Telemetry() if message.playing:
                sent[Estimate].add(message.seq)
            case Applied() if message.answered:
                sent[Command].add(message.seq)
            case _:
                pass
        if type(message) in came:
            came[type(message)].add(getattr(message, "seq", -1))
    names = {Position: "position", Estimate: "estimate", Command: "command", Applied: "applied"}
    missing = {
        name: sum(1 for seq in sent[kind] - came[kind] if seq >= 0) for kind, name in names.items()
    }
    return {name: count for name, count in missing.items() if count}
