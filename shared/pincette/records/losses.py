"""Samples that were sent and never came, as far as those that came can tell; pure.

A sample that is derived from another proves that the other was sent: an estimate its position,
the telemetry of a playing program its estimate, an answered tick its command, and an estimate the
applied voltage that it names.
"""

from collections.abc import Iterable

from pincette.messages import Applied, Command, Estimate, Message, Position, Telemetry


def lost(messages: Iterable[Message]) -> dict[str, int]:
    """How many are known to be missing, by topic; of one epoch."""
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
