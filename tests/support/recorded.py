"""Messages of a loop as a recorder receives them, with numbers that a careless copy would
change."""

import random
from collections.abc import Iterator
from pathlib import Path as FilePath

from pincette.control.planning.paths import Knot, Path
from pincette.control.planning.program import Guards, Program
from pincette.control.planning.segments import Track
from pincette.control.planning.sweep import Sweep
from pincette.core.faults import Cause, Mode, Outcome
from pincette.core.messages import (
    Applied,
    Burst,
    Command,
    Estimate,
    GroundTruth,
    JobNotice,
    Load,
    Message,
    Position,
    RequestLog,
    Sample,
    Telemetry,
    Timing,
)
from pincette.core.messages.arms import (
    ArmApplied,
    ArmCommand,
    ArmEstimate,
    ArmPosition,
    ArmTelemetry,
    ArmTruth,
)
from pincette.core.topics import TOPIC_OF
from pincette.records.mcap_file import McapFile
from tests.support.histograms import counted
from tests.support.laws import law_settings

EPOCH = 0x5A5A_1234_5678
PERIOD_S = 0.02
START_NS = 1_763_740_800_000_000_000
SWEEP = Sweep(1.0, 20.0, 5.0, 0.1, 200.0)
BEGUN = {"begin_at": "2025-11-21T16:00:00.000000Z"}
"""Start of the record, as its files state it."""
ABOUT = {"job": "j-1", "rig": "demo", "epoch": str(EPOCH), "period_s": repr(PERIOD_S)}


def tick(seq: int, chance: random.Random, *, final: bool = False) -> Iterator[Message]:
    """Return every message of one tick, in the order in which a loop sends them."""

    def number() -> float:
        return chance.choice((-0.0, 1e-300, chance.gauss(0.0, 1.0), chance.uniform(-1e6, 1e6)))

    def later() -> float | None:
        return None if seq < 2 else number()

    x, force, voltage = number(), number(), number()
    yield Position(EPOCH, seq, seq * PERIOD_S, (ArmPosition(x, valid=True),))
    if 3 <= seq < 9:
        yield Burst(EPOCH, seq, 1e4, (number(), -0.0), (0.1, number()), valid=True)
    yield Estimate(
        epoch=EPOCH,
        seq=seq,
        applied_seq=seq - 1,
        tripped=False,
        degraded=seq % 5 == 0,
        arms=(
            ArmEstimate(
                x_um=x,
                force_mN=force,
                force_uncertainty_mN=number(),
                perturbation_mN=number(),
                zero_age_s=later(),
                zero_refusal=None,
                applied_V=voltage,
                limits_active=seq % 4,
            ),
        ),
        valid=True,
    )
    yield Telemetry(
        epoch=EPOCH,
        seq=seq,
        playing=not final,
        phase="hold · µ",
        segment=1,
        segment_tick=seq,
        arms=(ArmTelemetry(number(), number()),),
        force_r_mN=number(),
        sliding_um=number(),
        band_um=number(),
        perturbation_mN=number(),
        perturbation_error_mN=number(),
        residual_um=number(),
        outcome=Outcome.GRIPPED if final else Outcome.NONE,
        contact_x_um=later(),
        contact_stiffness_mN_per_um=None,
        held=seq > 1,
        acted=(),
    )
    yield Command(
        epoch=EPOCH,
        seq=seq,
        owner=2**47 + 5,
        arms=(ArmCommand(voltage),),
        part_held=seq > 1,
        zero=seq == 0,
        final=final,
        valid=True,
        sweep=SWEEP if seq == 1 else None,
    )
    yield GroundTruth(1000 + seq, (ArmTruth(x, force, voltage),))
    yield Applied(
        epoch=EPOCH,
        seq=seq,
        arms=(ArmApplied(voltage, 0),),
        state=Mode.IDLE if final else Mode.ARMED,
        cause=Cause.NONE,
        part_held=seq > 1,
        zero=seq == 0,
        final=final,
        answered=True,
        refused=0,
        command_age_s=0.004,
    )


def loop(count: int, seed: int = 1) -> list[Message]:
    """Return all messages of an arming of this many ticks; the last one is final."""
    chance = random.Random(seed)
    return [
        message for seq in range(count) for message in tick(seq, chance, final=seq == count - 1)
    ]


def notice(state: str = "running") -> JobNotice:
    """Return the supervisor's notice of the job."""
    return JobNotice("j-1", "grip", EPOCH, state, "hold", "", held=True, at="2026-03-01T12:00:00Z")


def asked() -> RequestLog:
    """Return the program of the controller, with a path whose names are similar."""
    path = Path("force", "sinusoid", mean=10.0, amplitude=-0.0, cycle_s=0.5, cycles=2)
    held = Track("hold", path.duration_s, force=path)
    knots = (Knot(0.0, 1.0, 0.0), Knot(1.0, 0.1 + 0.2, 0.0))
    moved = Track("move", 1.0, force=Path("position", "waypoints", knots=knots))
    guards = Guards(2.0, 3, 40.0, 0.3, 5, 1.5, 2.9, 1.0)
    laws = (law_settings().spec(), law_settings("dsmifc").spec())
    load = Load(Program((held, moved), guards, 2.17, laws))
    return RequestLog(EPOCH, -1, "controller", "", load=load)


def timing(service: str, seq: int, *lates_s: float) -> Timing:
    """Return a program's report of its punctuality."""
    spent = counted([0.0004] * len(lates_s))
    return Timing(EPOCH, seq, service, 2, counted(lates_s), counted(()), spent)


def write(path: FilePath, messages: list[Message], *, finish: bool = True) -> McapFile:
    """Write a record of these messages."""
    file = McapFile(path, "demo", about=ABOUT, start_ns=START_NS, period_s=PERIOD_S)
    for place, message in enumerate(messages):
        file.add(message, START_NS + place)
    if finish:
        file.finish(
            {"messages": str(len(messages)), "dropped": "0", "complete": "true", "detail": ""}
        )
    else:
        file.flush()
        file.abandon()
    return file


def sample_0_ns(messages: list[Message]) -> int:
    """Return the arrival of sample 0 in a record that ``write`` makes of these messages."""
    return START_NS + next(
        place for place, message in enumerate(messages) if isinstance(message, Sample)
    )


def name_of(message: Message) -> str:
    """Return the topic of a message."""
    return TOPIC_OF[type(message)].name
