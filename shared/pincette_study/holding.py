"""A minute of hold: how far the estimate drifts, with and without a zero just before contact."""

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from pincette.config import RigFile, derived
from pincette.control.planning.grip_plan import GripRequest, plan_grip
from pincette.control.planning.program import Program, Segment
from pincette.plotting import BLUE, GREEN, ORANGE, Axis, label, legend_above, picture
from pincette_study.closed_loop import Record, StudyError, outcome, play, record
from pincette_study.report import Comparison, Picture, Section

HOLD_S = 60.0
WAIT_S = 60.0
"""Between the first zero and the approach: long enough for creep to go on."""
EDGE_S = 1.0
"""Over which the error is averaged at the begin and the end of the hold."""


def long_hold(rig: RigFile) -> Section:
    """Hold for a minute, once zeroed just before contact and once only a minute before that."""
    records = {
        "zeroed just before contact": _hold(rig, _program(rig)),
        "zeroed once, a minute before": _hold(rig, _without_second_zero(_program(rig))),
    }
    edge = round(EDGE_S / rig.rig.period_s)
    rows: list[Comparison] = []
    for name, seen in records.items():
        error = seen.force_mN - seen.true_force_mN
        begin, end = _mean(error[edge : 2 * edge]), _mean(error[-edge:])
        true_mN = seen.true_force_mN
        true_drift = _mean(true_mN[-edge:]) - _mean(true_mN[edge : 2 * edge])
        rows += [
            Comparison(f"{name}: error as the hold begins", "mN", None, begin),
            Comparison(f"{name}: error after {HOLD_S:g} s", "mN", None, end),
            Comparison(f"{name}: drift", "mN", None, end - begin),
            Comparison(f"{name}: drift of the true force", "mN", None, true_drift),
        ]
    return Section(
        key="hold",
        title="A minute of hold",
        text=(
            f"{rig.grip.force_mN:g} mN held for {HOLD_S:g} s in closed loop. While a part is held "
            "the force cannot be zeroed; what can be chosen is how old the zero is when contact "
            "is made. The sensor's noise moves the voltage to and fro all the while.",
        ),
        pictures=(Picture("hold", "error of the estimate over the hold", _picture(records, rig)),),
        comparisons=tuple(rows),
    )


def _mean(values: NDArray[np.float64]) -> float:
    return float(np.mean(values))


def _program(rig: RigFile) -> Program:
    grip, part = rig.grip, rig.part
    plan = plan_grip(
        GripRequest(
            force_mN=grip.force_mN,
            hold_s=HOLD_S,
            load_s=grip.load_s,
            approach_um_per_s=grip.approach_um_per_s,
            seek_um_per_s=grip.seek_um_per_s,
            contact_force_mN=grip.contact_force_mN,
            zero_s=grip.zero_s,
            contact_um=part.contact_um,
            contact_tolerance_um=part.contact_tolerance_um,
            stiffness_mN_per_um=part.stiffness_mN_per_um,
            stiffness_tolerance=part.stiffness_tolerance,
        ),
        derived.planned_rig(rig),
    )
    return plan.program


def _without_second_zero(program: Program) -> Program:
    """Wait after the first zero, and leave the one just before contact out."""
    first, approach, second, *others = program.segments
    if (first.kind, approach.kind, second.kind) != ("zero", "free", "zero"):
        raise StudyError("a grip is expected to begin with a zero, an approach and a zero")
    wait = Segment("wait", "free", WAIT_S, x_to_um=0.0)
    return replace(program, segments=(first, wait, approach, *others))


def _hold(rig: RigFile, program: Program) -> Record:
    messages = play(rig, program)
    if outcome(messages) != "gripped":
        raise StudyError(f"the grip ended {outcome(messages)!r}")
    return record(messages, "hold", rig.rig.period_s)


def _picture(records: dict[str, Record], rig: RigFile) -> bytes:
    def draw(axes: list[Axis]) -> None:
        for (name, seen), color in zip(records.items(), (BLUE, ORANGE), strict=True):
            t = np.arange(len(seen.force_mN)) * rig.rig.period_s
            error = seen.force_mN - seen.true_force_mN
            axes[0].plot(t, error, color=color, linewidth=0.7, label=name)
            axes[1].plot(t, seen.true_force_mN, color=color, linewidth=0.9, label=name)
        axes[0].axhline(0.0, color=GREEN, linestyle="--")
        label(axes[0], "", "estimate less true / mN")
        label(axes[1], "time / s", "true force / mN")
        legend_above(axes[0])
        legend_above(axes[1])

    return picture(2, 1, 4.6, draw, sharex=True)
