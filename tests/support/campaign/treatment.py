"""Treatment of one rig of the campaign: its bring-up, its grips, and their stated results."""

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import ceil
from pathlib import Path
from typing import Any

from pincette.api.jobs import Job
from pincette.api.predictions import Violation
from pincette.control.planning.program import Program
from pincette_supervisor.problems import ProblemError
from tests.support.campaign.arm import Part
from tests.support.campaign.drawing import Drawn, GripWish, draw
from tests.support.campaign.laboratory import REQUEST, Laboratory, Watched, laboratory

SKIPPED_S = 0.5
"""Start of a hold that is left out of its mean force, as in the product's result."""
RANGE_UM, RANGE_V = 0.5, 0.01
"""Tolerance of the stated range of position and voltage, for the ringing and the output step."""
LOUDER = 1.1
"""Contact force as a multiple of its uncertainty, after a plan was refused because of that
uncertainty."""
LAST = 5
"""Number of samples at the end of a job whose mean force is compared."""
MARKS = ("position_step", "warnings", "unverified", "model_mismatch", "zero_invalid", "marks")
"""Members of a result that mark a force as doubtful if they are not empty."""


@dataclass(frozen=True)
class Gripped:
    """One grip: its requested, stated and true values."""

    seed: int
    wish: GripWish
    events: str
    """Name of what happened: ``plain``, ``stiffness``, ``restart``, ``slip``, ``presses``,
    ``gain``."""
    outcome: str
    cause: str = ""
    peak_mN: float = 0.0
    begin_mN: float = 0.0
    """True force at the start of the job, from a part that presses the resting arm."""
    beyond: str = ""
    """Quantity whose stated range the arm has left; empty: none."""
    held_mN: float | None = None
    uncertainty_mN: float | None = None
    true_mN: float | None = None
    last_mN: float | None = None
    last_uncertainty_mN: float | None = None
    last_true_mN: float | None = None
    marked: bool = False

    @property
    def error_mN(self) -> float | None:
        """Stated held force minus the true one."""
        if self.held_mN is None or self.true_mN is None:
            return None
        return self.held_mN - self.true_mN

    @property
    def wrong(self) -> bool:
        """Return whether the held force was outside its uncertainty U without a mark."""
        if self.outcome != "gripped" or self.marked or self.error_mN is None:
            return False
        return abs(self.error_mN) > (self.uncertainty_mN or 0.0)

    @property
    def last_wrong(self) -> bool:
        """Return whether the force at the job's end was outside its uncertainty U."""
        if self.last_mN is None or self.last_true_mN is None or self.marked:
            return False
        return abs(self.last_mN - self.last_true_mN) > (self.last_uncertainty_mN or 0.0)

    def __str__(self) -> str:
        """Return the grip as a line on a terminal."""
        held = ""
        if self.error_mN is not None and self.uncertainty_mN is not None:
            held = f", held {self.error_mN:+.2f} of U {self.uncertainty_mN:.2f} mN"
        last = ""
        if self.last_wrong:
            last = f", ends at {self.last_mN:+.2f} ± {self.last_uncertainty_mN:.2f} mN, "
            last += f"true {self.last_true_mN:.2f} mN"
        words = [word for word in (self.beyond and f"beyond {self.beyond}", self.cause) if word]
        wrong = " WRONG" * self.wrong
        return (
            f"  {self.events:9s} {self.wish.profile:6s} K x{self.wish.stiffness_share:.2f}: "
            f"{self.outcome}, peak {self.peak_mN:.2f} of {self.wish.force_mN:.2f} mN{held}{last}"
            f"{'; ' * bool(words)}{'; '.join(words)}{wrong}"
        )


@dataclass
class Treated:
    """Results of one rig: its grips, and why it could not be brought up."""

    drawn: Drawn
    failed: str = ""
    """Reason why the rig could not be brought up; empty if it was brought up."""
    grips: list[Gripped] = field(default_factory=list[Gripped])

    def lines(self) -> Iterator[str]:
        """Yield the rig as lines on a terminal."""
        yield f"{self.drawn.label}: {self.failed or 'brought up'}"
        yield from map(str, self.grips)


def treat(seed: int) -> Treated:
    """Draw one rig, bring it up, and grip with it."""
    drawn = draw(seed)
    treated = Treated(drawn)
    with tempfile.TemporaryDirectory() as folder, laboratory(drawn, Path(folder)) as opened:
        treated.failed = opened.bring_up()
        if treated.failed:
            return treated
        for wish in drawn.grips:
            treated.grips.append(_grip(opened, wish))
    return treated


def _events(wish: GripWish) -> str:
    if wish.presses_um is not None:
        return "presses"
    if wish.slip is not None:
        return "slip"
    if wish.gain is not None:
        return "gain"
    if wish.restart_s is not None:
        return "restart"
    return "plain" if wish.stiffness_share == 1.0 else "stiffness"


def _grip(opened: Laboratory, wish: GripWish) -> Gripped:
    arm, drawn = opened.arm, opened.drawn
    rig = opened.office.manager.context.rig
    stiffness = wish.stiffness_share * rig.part.stiffness_mN_per_um
    if wish.gain is not None:
        name, factor = wish.gain
        setattr(arm, name, getattr(arm, name) * factor)
    if wish.restart_s is not None:
        opened.restart(wish.restart_s)
    # The position of the part when the rig was brought up: ``part.contact_um`` is a reading that
    # drifts.
    part = Part(drawn.contact_um + wish.contact_off_um, stiffness)
    if wish.slip is not None:
        share, way_um = wish.slip
        part = replace(part, slip_force_mN=share * wish.force_mN, slip_um=way_um, slips_left=1)
    if wish.presses_um is None:
        opened.put_part(part)
    else:
        arm.part = Part(arm.x_um - wish.presses_um, stiffness)
        arm.rest(0.5)
    body: dict[str, Any] = {
        "kind": "grip",
        "autostart": True,
        "rig": drawn.rig.rig.name,
        "force_mN": round(wish.force_mN, 3),
        "hold_s": 3.0,
        "profile": wish.profile,
    }
    gripped = Gripped(drawn.seed, wish, _events(wish), "")
    try:
        gripped = _judged(opened, gripped, opened.confirmed(body))
    except ProblemError as error:
        gripped = replace(gripped, outcome="refused", cause=f"{error.code}: {error}"[:160])
    if wish.presses_um is not None:
        arm.part = None
        arm.rest(2.0)
    _tidy(opened)
    return gripped


def _judged(opened: Laboratory, gripped: Gripped, body: dict[str, Any]) -> Gripped:
    manager = opened.office.manager
    try:
        planned = manager.plan(REQUEST.validate_python(body))
        if louder_mN := _contact_force_mN(planned.plan.violations):
            body = body | {"contact_force_mN": louder_mN}
            planned = manager.plan(REQUEST.validate_python(body))
        program = planned.program
        begin_mN = opened.arm.force_mN
        job = opened.run(body)
    except ProblemError:
        # A person whose quick grip is refused tries the gentle profile.
        if body["profile"] == "gentle":
            raise
        gentle = replace(gripped, wish=replace(gripped.wish, profile="gentle"))
        return _judged(opened, gentle, body | {"profile": "gentle"})
    watched, result = opened.watched, job.result or {}
    held_mN, true_mN = result.get("force_held_mN"), _true_held(watched, opened)
    last = [one for one in list(watched.samples.values())[-LAST:] if one.estimate.valid]
    known = bool(last) and all(one.estimate.arms[0].zero_age_s is not None for one in last)
    return replace(
        gripped,
        outcome=str(result.get("outcome", job.state)),
        cause="" if job.state == "succeeded" else f"{job.state}: {job.cause}"[:160],
        peak_mN=opened.arm.peak_mN,
        begin_mN=begin_mN,
        beyond=_beyond(watched, program),
        held_mN=held_mN,
        uncertainty_mN=result.get("force_uncertainty_mN"),
        true_mN=true_mN,
        last_mN=_mean([one.estimate.arms[0].force_mN for one in last]) if known else None,
        last_uncertainty_mN=_mean([one.estimate.arms[0].force_uncertainty_mN for one in last]),
        last_true_mN=_mean([one.truth.force_mN for one in last]),
        marked=_marked(job),
    )


def _contact_force_mN(violations: Sequence[Violation]) -> float | None:
    """Return the contact force that a person states where the plan says that it is uncertain."""
    for found in violations:
        if found.pointer == "/contact_force_mN" and found.quantity == "force":
            return ceil(10.0 * LOUDER * found.limit) / 10.0
    return None


def _true_held(watched: Watched, opened: Laboratory) -> float | None:
    """Return the mean true force over the hold without its start."""
    held = [seq for seq, view in watched.views.items() if view.phase == "hold"]
    if not held:
        return None
    begin = min(held) + round(SKIPPED_S / opened.drawn.rig.rig.period_s)
    truths = [watched.samples[seq].truth.force_mN for seq in held if seq >= begin]
    return _mean(truths) if truths else None


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None


def _beyond(watched: Watched, program: Program) -> str:
    """Return the quantity that has left the range stated by the plan."""
    planned = program.planned_range
    if planned is None:
        return "unstated"
    truths = [one.truth for one in watched.samples.values()]
    if not truths:
        return ""
    furthest_um = max(truth.x_um for truth in truths)
    voltages_V = [truth.voltage_V for truth in truths]
    high_um, voltage = planned.position_max_um, planned.voltages[0]
    found: list[str] = []
    if high_um is not None and furthest_um > high_um + RANGE_UM:
        found.append(f"position {furthest_um:.3g} > {high_um:.3g} µm")
    if max(voltages_V) > voltage.max_V + RANGE_V:
        found.append(f"voltage {max(voltages_V):.3g} > {voltage.max_V:.3g} V")
    if min(voltages_V) < voltage.min_V - RANGE_V:
        found.append(f"voltage {min(voltages_V):.3g} < {voltage.min_V:.3g} V")
    return ", ".join(found)


def _marked(job: Job) -> bool:
    """Return whether the result marks its force as doubtful by a code."""
    result: dict[str, Any] = job.result or {}
    goal: dict[str, Any] = result.get("goal") or {}
    return goal.get("met") is False or any(result.get(name) for name in MARKS)


def _tidy(opened: Laboratory) -> None:
    """Leave the rig as a person does: not latched and without a held part."""
    opened.reset()
    if opened.rig.applied and opened.rig.applied[-1].part_held:
        name = opened.drawn.rig.rig.name
        opened.run({"kind": "release", "rig": name, "autostart": True})
    opened.arm.part = None
