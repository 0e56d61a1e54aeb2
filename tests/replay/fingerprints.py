"""Hash the numbers of ten programs, to show that a change of structure changes no number.

    python -m tests.replay.fingerprints > after.txt

Run it before and after a change, and compare the two outputs. The hashes are of numbers in a fixed
order, so that a renamed field or class changes a path in ``NUMBERS`` and no hash.
"""

import hashlib
import struct
import sys
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from pincette.config import RigFile
from pincette.config.laws import law_definition
from pincette.control.planning.program import Program
from pincette.control.record import replace
from pincette.core.messages import (
    Applied,
    Command,
    Estimate,
    Message,
    Position,
    Telemetry,
)
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.kinds.motions import MoveJobRequest
from pincette_supervisor.kinds.track import TrackJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from tests.replay.desk import Desk, Watch, nobody
from tests.support.rigs import demo_rig
from tests.support.two_arms import short_grip, two_arm_rig

NUMBERS: dict[type[Message], tuple[str, ...]] = {
    Position: ("seq", "t_s", "arms.0.x_um", "arms.0.valid", "arms.1.x_um"),
    Estimate: (
        "seq",
        "arms.0.x_um",
        "arms.0.force_mN",
        "arms.0.force_uncertainty_mN",
        "arms.0.perturbation_mN",
        "arms.0.zero_age_s",
        "arms.0.applied_V",
        "arms.0.touch_x_um",
        "arms.0.touch_mN",
        "valid",
        "arms.1.x_um",
        "arms.1.force_mN",
        "arms.1.force_uncertainty_mN",
        "arms.1.applied_V",
    ),
    Command: (
        "seq",
        "arms.0.voltage_V",
        "part_held",
        "zero",
        "final",
        "valid",
        "arms.0.force_mN",
        "arms.0.x_d_um",
        "segment",
        "segment_tick",
        "arms.1.voltage_V",
        "arms.1.force_mN",
        "arms.1.x_d_um",
    ),
    Applied: (
        "seq",
        "arms.0.voltage_V",
        "arms.0.limits_active",
        "segment",
        "segment_tick",
        "arms.1.voltage_V",
    ),
    Telemetry: (
        "seq",
        "playing",
        "segment",
        "segment_tick",
        "arms.0.x_r_um",
        "arms.0.x_d_um",
        "force_r_mN",
        "sliding_um",
        "perturbation_mN",
        "residual_um",
        "contact_x_um",
        "contact_stiffness_mN_per_um",
        "held",
        "paused",
        "arms.1.x_r_um",
        "place_um",
        "place_r_um",
    ),
}
"""Numbers of each message that are hashed, in this order."""


class Play(NamedTuple):
    """A program to play, and the actions of a person meanwhile."""

    name: str
    rig: RigFile
    program: Program
    watch: Callable[[], Watch] = lambda: nobody


def script(*actions: tuple[str, int, str]) -> Callable[[], Watch]:
    """Act at ticks of phases, one after another; ``+`` counts messages since the last action."""

    def begun() -> Watch:
        left, passed = list(actions), [0]

        def watch(desk: Desk, message: Telemetry | Applied) -> None:
            if not left or not isinstance(message, Telemetry) or not message.playing:
                return
            phase, tick, action = left[0]
            passed[0] += 1
            here = (message.phase, message.segment_tick) == (phase, tick)
            if here or (phase == "+" and passed[0] >= tick):
                left.pop(0)
                passed[0] = 0
                desk.act(action)

        return watch

    return begun


def plays() -> Sequence[Play]:
    """Return the ten programs."""
    demo, pair = demo_rig(time="lockstep"), two_arm_rig()
    grip = plan_job(GripJobRequest(kind="grip", hold_s=0.3), demo).program
    gentle = GripJobRequest(kind="grip", profile="gentle", hold_s=0.3)
    track = TrackJobRequest(kind="track", frequency_hz=2.0, cycles=2)
    move = MoveJobRequest(kind="move", to_um=10.0)

    def by(scheme: str) -> Program:
        spec = law_definition(scheme).settings("identified").spec()
        return replace(grip, laws=(spec,))

    return (
        Play("quick grip", demo, grip),
        Play("gentle grip", demo, plan_job(gentle, demo).program),
        Play("grip by dsmifc", demo, by("dsmifc")),
        Play("grip by fpbsmic", demo, by("fpbsmic")),
        Play("track", demo, plan_job(track, demo).program),
        Play("move", demo, plan_job(move, demo).program),
        Play("pause, resume", demo, grip, script(("hold", 5, "pause"), ("+", 20, "resume"))),
        Play("stop in the seek", demo, grip, script(("contact", 4, "stop"))),
        Play("let go in the load", demo, grip, script(("load", 6, "let_go"))),
        Play(
            "two arms, stop, release",
            pair,
            short_grip(pair, 0.3),
            script(("hold", 5, "stop"), ("+", 10, "release")),
        ),
    )


def number(message: Message, path: str) -> bytes:
    """Return the bits of a number of a message; empty if the field is absent."""
    name, _, of_arm = path.partition(".")
    value: Any = getattr(message, name)
    if of_arm:
        arm, _, field = of_arm.partition(".")
        value = getattr(value[int(arm)], field) if int(arm) < len(value) else None
    return b"-" if value is None else struct.pack("<d", float(value) + 0.0)


def fingerprint(messages: Sequence[Message]) -> tuple[int, str]:
    """Return the count of messages that were hashed, and the hash of their numbers."""
    found, count = hashlib.sha256(), 0
    for message in messages:
        paths = NUMBERS.get(type(message))
        if paths is not None:
            count += 1
            found.update(b"".join(number(message, path) for path in paths))
    return count, found.hexdigest()[:16]


def main() -> None:
    """Print one line for each program."""
    for play in plays():
        messages = Desk(play.rig).play(play.program, 1, play.watch())
        count, digest = fingerprint(messages)
        sys.stdout.write(f"{digest} {count:6d} {play.name}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
