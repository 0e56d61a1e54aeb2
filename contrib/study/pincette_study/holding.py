"""Hold of one minute: drift of the estimated force, and why it is zeroed just before contact."""

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from pincette.config import RigFile, derived
from pincette.control.planning.grip_plan import GripRequest, plan_grip
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Move, Rest
from pincette.core.faults import Outcome
from pincette.core.messages import Estimate, Telemetry
from pincette.plotting import BLUE, GREEN, Axis, label, picture
from pincette_study.closed_loop import Record, StudyError, outcome, play, record
from pincette_study.report import Comparison, Picture, Section

HOLD_S = 60.0
WAIT_S = 60.0
"""Time between the first zero and the approach in s, long enough for creep to continue."""
EDGE_S = 1.0
"""Time over which the error is averaged at the start and the end of the hold, in s."""


def long_hold(rig: RigFile) -> Section:
    """Hold for a minute after a zero just before contact; also with a zero one minute old."""
    seen = _hold(rig, _program(rig))
    edge = round(EDGE_S / rig.rig.period_s)
    error, true_mN = seen.force_mN - seen.true_force_mN, seen.true_force_mN
    begin, end = _mean(error[edge : 2 * edge]), _mean(error[-edge:])
    true_drift = _mean(true_mN[-edge:]) - _mean(true_mN[edge : 2 * edge])
    name = "zeroed just before contact"
    return Section(
        key="hold",
        title="A minute of hold",
        text=(
            f"{rig.grip.force_mN:g} mN held for {HOLD_S:g} s in closed loop. While a part is "
            "held the force cannot be zeroed; what can be chosen is how old the zero is "
            f"when contact is made. With a zero {WAIT_S:g} s before the approach the "
            "uncertainty at contact is as large as the force, since nothing is known of the "
            "arm's past, and the grip ends as uncertain_force. The sensor's noise moves the "
            "voltage back and forth all the time.",
        ),
        pictures=(Picture("hold", "error of the estimate during the hold", _picture(seen, rig)),),
        comparisons=(
            Comparison(f"{name}: error as the hold begins", "mN", None, begin),
            Comparison(f"{name}: error after {HOLD_S:g} s", "mN", None, end),
            Comparison(f"{name}: drift", "mN", None, end - begin),
            Comparison(f"{name}: drift of the true force", "mN", None, true_drift),
            Comparison("zeroed a minute before: U at contact", "mN", None, _refused_mN(rig)),
        ),
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
    """Return the program with a wait after the first zero, and without the zero before contact."""
    first, approach, second, *others = program.segments
    rests = isinstance(first, Rest) and isinstance(second, Rest)
    if not (rests and isinstance(approach, Move)):
        raise StudyError("a grip is expected to begin with a zero, an approach and a zero")
    wait = Move("wait", WAIT_S, to_um=(0.0,))
    return replace(program, segments=(first, wait, approach, *others))


def _hold(rig: RigFile, program: Program) -> Record:
    messages = play(rig, program)
    if outcome(messages) != "gripped":
        raise StudyError(f"the grip ended {outcome(messages)!r}")
    return record(messages, "hold", rig.rig.period_s)


def _refused_mN(rig: RigFile) -> float:
    """Return U in mN at which a grip with an old zero is ended; raises StudyError otherwise."""
    messages = play(rig, _without_second_zero(_program(rig)))
    if outcome(messages) != Outcome.UNCERTAIN_FORCE:
        raise StudyError(f"a grip with an old zero ended {outcome(messages)!r}")
    views = [m for m in messages if isinstance(m, Telemetry)]
    contact = {view.seq for view in views if view.phase == "contact"}
    estimates = [m for m in messages if isinstance(m, Estimate) and m.seq in contact]
    return estimates[-1].arms[0].force_uncertainty_mN


def _picture(seen: Record, rig: RigFile) -> bytes:
    def draw(axes: list[Axis]) -> None:
        t = np.arange(len(seen.force_mN)) * rig.rig.period_s
        axes[0].plot(t, seen.force_mN - seen.true_force_mN, color=BLUE, linewidth=0.7)
        axes[1].plot(t, seen.true_force_mN, color=BLUE, linewidth=0.9)
        axes[0].axhline(0.0, color=GREEN, linestyle="--")
        label(axes[0], "", "estimate minus true / mN")
        label(axes[1], "time / s", "true force / mN")

    return picture(2, 1, 4.6, draw, sharex=True)
