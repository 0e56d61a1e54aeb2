"""Which sample a truth of the simulated rig belongs to.

A simulated rig knows no sample numbers: it counts the voltages that were written to it. So its
truths are told from their order: one for each tick in which the actuator wrote.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from pincette.messages import Applied, Truth


def number_truths(truths: Sequence[Truth], applied: Mapping[int, Applied]) -> dict[int, Truth]:
    """Truths by the number of their sample, the first truth belonging to the first tick.

    In lockstep every tick writes; in real time one without a command does not. Once the actuator
    has tripped it writes as often as it likes, and truths are left out.
    """
    ticks: list[int] = []
    for seq in range(max(applied, default=-1) + 1):
        if seq in applied and applied[seq].state not in ("armed", "idle"):
            break
        ticks.append(seq)
    if not truths or not ticks:
        return {}
    first = min(truth.seq for truth in truths)
    if max(truth.seq for truth in truths) - first + 1 < len(ticks):
        ticks = [seq for seq in ticks if seq not in applied or applied[seq].answered]
    numbers = {first + place: seq for place, seq in enumerate(ticks)}
    return {
        numbers[truth.seq]: replace(truth, seq=numbers[truth.seq])
        for truth in truths
        if truth.seq in numbers
    }
