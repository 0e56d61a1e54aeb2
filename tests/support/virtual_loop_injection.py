"""A fault in a virtual loop, and its outcome compared with the required one."""

from dataclasses import dataclass
from typing import Literal

from pincette.core.wording import applied_text
from tests.support.reactions import TRIPPED, within
from tests.support.scripted import PROGRAM
from tests.support.virtual_loop import VirtualLoop
from tests.support.virtual_loop_bench import scripted
from tests.support.virtual_loop_faults import LinkFault
from tests.support.virtual_loop_places import EPOCH, FREEZE_S, Place

Must = Literal["trip", "carry on"]
REACTION_PERIODS = 3.0
"""Limit in periods from the fault to the freeze, or to the first step of the ramp."""
STEP_PERIODS = 0.25
"""Time in periods by which a ramp may exceed that of the rig file: its steps are a quarter of a
period."""
AFTER_S = 0.06
"""Time for which the loop is watched afterwards, in s: nothing may move, no command may be
accepted."""
WATCHED_TICKS = 10
WATCHED_S = 0.06
"""Time for which a fault that must not trip is watched, in s: the longer of both."""
RINGS_FROM_S, RINGS_TO_S, RINGS_STEP_S = 0.010, 0.022, 0.001
"""Time after the last voltage of a ramp until the output has settled: four periods of the mode."""
LEAST_STROKE_UM = 1.0
RINGING_SHARE = 0.05
"""Largest ringing of the mode after a ramp, as a share of the stroke; the motion for one step of
the output is added, since the voltage is rounded."""
SILENCE = "command_age: no command for "


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault of a loop, and the required outcome.

    ``kill``  a program ends without notice.
    ``stop``  a program does not run for ``for_s``.
    ``slow``  the next step of a program takes ``for_s`` longer.
    ``link``  the messages of ``links`` have a fault from now on, for ``for_s``.
    ``bench`` the simulated rig executes the command ``target`` ``what``, for ``for_s``.
    ``rival`` a second controller, armed for the same epoch, also sends commands.
    """

    name: str
    row: int
    must: Must
    deed: Literal["kill", "stop", "slow", "link", "bench", "rival"]
    who: str = ""
    for_s: float | None = None
    links: tuple[LinkFault, ...] = ()
    target: str = ""
    what: str = ""
    late_s: float = 0.0
    """Time that is allowed in addition to the limit for a silence, in s: a stuck sensor must be
    detected first."""


@dataclass(frozen=True, slots=True)
class Reaction:
    """Outcome of one injection; times since the fault."""

    fault: str
    state: str
    held: bool
    phase: float
    reaction_s: float
    """Time until the freeze, or the first voltage of the ramp, was published."""
    safe_s: float
    """Time until the safe voltage was output, in s; with a part held, after the freeze."""
    ringing_um: float
    stroke_um: float
    cause: str

    @property
    def ringing_share(self) -> float:
        """Ringing divided by the arm's travel, for tables; divided by ``LEAST_STROKE_UM`` if the
        travel was less."""
        return self.ringing_um / max(self.stroke_um, LEAST_STROKE_UM)


def part_event(loop: VirtualLoop, fault: Fault) -> None:
    """Let the fault happen now."""
    match fault.deed:
        case "kill":
            loop.kill(fault.who)
        case "stop":
            loop.stop(fault.who, fault.for_s or 0.0)
        case "slow":
            loop.programs[fault.who].slow_s = fault.for_s or 0.0
        case "link":
            loop.links += [_from(loop.now_s, fault.for_s, link) for link in fault.links]
        case "bench":
            loop.bench.order(scripted(fault.target, fault.what, for_s=fault.for_s))
        case "rival":
            loop.add_rival(PROGRAM, EPOCH)


def _from(now_s: float, for_s: float | None, link: LinkFault) -> LinkFault:
    end_s = float("inf") if for_s is None else now_s + for_s
    return LinkFault(
        link.befalls,
        link.source,
        link.to,
        now_s,
        end_s,
        link.late_s,
        link.share,
        link.field,
        link.value,
    )


def inject(at: Place, fault: Fault, phase: float, seed: int) -> Reaction | None:
    """Let a fault happen in a fork of a loop, ``phase`` periods after a grid point, and judge it.

    Returns None if it must not trip and did not; an idle rig does not move, whatever the fault.
    """
    loop = at.loop.fork(seed)
    loop.run(loop.now_s + phase * loop.rig.rig.period_s)
    part_event(loop, fault)
    case = f"{fault.name} in {at.state}, {phase:.4f} T after a grid point, seed {seed}"
    if fault.must == "carry on" or at.state == "idle":
        _check_carries_on(loop, at, case)
        return None
    return _check_trips(loop, at, fault, phase, case)


def _check_carries_on(loop: VirtualLoop, at: Place, said: str) -> None:
    began_s, answered, put_out = loop.now_s, 0, len(loop.put_out)
    watched_s = max(WATCHED_S, WATCHED_TICKS * loop.rig.rig.period_s)
    loop.run(began_s + watched_s)
    for at_s, echo in loop.applied:
        assert echo.state in ("armed", "idle"), f"false trip by {said}: {applied_text(echo)}"
        answered += echo.answered and at_s > began_s
    if at.state == "idle":
        assert len(loop.put_out) == put_out, f"an idle rig moved after {said}"
    else:
        ended = any(echo.state == "idle" for _, echo in loop.applied)
        ticks = watched_s / loop.rig.rig.period_s
        assert ended or answered >= 0.7 * ticks, f"{answered} commands were accepted after {said}"


def _check_trips(loop: VirtualLoop, at: Place, fault: Fault, phase: float, said: str) -> Reaction:
    began_s, begun_um, period_s = loop.now_s, loop.bench.x_um, loop.rig.rig.period_s
    limit_s = REACTION_PERIODS * period_s + fault.late_s
    safe_s = limit_s + loop.rig.safety.ramp_s + STEP_PERIODS * period_s
    over_s = began_s + safe_s + (FREEZE_S + 2.0 * period_s if at.held else 0.0)
    loop.run(over_s, lambda: loop.newest.state == "latched")
    tripped = [(at_s, echo) for at_s, echo in loop.applied if echo.state in TRIPPED]
    assert tripped, f"no trip by {said}: {loop.applied[-1]}"
    reacted_s, first = tripped[0]
    assert first.state == ("frozen" if first.part_held else "ramping"), f"{said}: {first}"
    within(limit_s, reacted_s - began_s, f"{said}: the reaction")
    latched_s = loop.applied[-1][0]
    assert loop.newest.state == "latched", f"{said}: not latched in time: {loop.applied[-1]}"
    frozen = [echo for _, echo in tripped if echo.state == "frozen"]
    assert len({echo.arms[0].voltage_V for echo in frozen}) <= 1, f"{said}: a frozen voltage moved"
    ramped_s = next(at_s for at_s, echo in tripped if echo.state == "ramping")
    if frozen:
        assert ramped_s - reacted_s >= FREEZE_S - 0.3 * period_s, (
            f"{said}: the freeze was too short"
        )
    _check_ramp(loop, reacted_s, said)
    loop.run(latched_s + RINGS_FROM_S)
    ringing_um = 0.0
    for step in range(round((RINGS_TO_S - RINGS_FROM_S) / RINGS_STEP_S)):
        loop.run(latched_s + RINGS_FROM_S + step * RINGS_STEP_S)
        ringing_um = max(ringing_um, loop.bench.ringing_um())
    stroke_um = abs(begun_um - loop.bench.x_um)
    loop.run(latched_s + AFTER_S)
    after = [echo for at_s, echo in loop.applied if at_s >= reacted_s]
    assert not any(echo.answered for echo in after), (
        f"{said}: a command was accepted after the trip"
    )
    moved = [put_V for at_s, put_V in loop.put_out if at_s > latched_s]
    assert set(moved) <= {loop.rig.safety.safe_V}, f"{said}: {moved} after the latch"
    assert {echo.cause for echo in after} == {first.cause}, f"{said}: the first cause was replaced"
    reaction = Reaction(
        fault=fault.name,
        state=at.state,
        held=bool(frozen),
        phase=phase,
        reaction_s=reacted_s - began_s,
        safe_s=_safe_at(loop, reacted_s) - began_s - (ramped_s - reacted_s if frozen else 0.0),
        ringing_um=ringing_um,
        stroke_um=stroke_um,
        cause=applied_text(first),
    )
    within(safe_s, reaction.safe_s, f"{said}: the ramp to the safe voltage")
    most_um = RINGING_SHARE * stroke_um + loop.bench.step_um
    assert ringing_um <= most_um, f"{said}: the output rings, limit {most_um:.3f} µm: {reaction}"
    assert applied_text(first).startswith(SILENCE), f"{said}: {applied_text(first)}"
    return reaction


def _safe_at(loop: VirtualLoop, since_s: float) -> float:
    """Return when the safe voltage first reached the plant."""
    safe_V = loop.rig.safety.safe_V
    return next(at_s for at_s, put_V in loop.put_out if at_s >= since_s and put_V == safe_V)


def _check_ramp(loop: VirtualLoop, since_s: float, said: str) -> None:
    """Check that from the trip on the voltage goes to the safe one and never reverses."""
    safe_V = loop.rig.safety.safe_V
    away_V = [abs(put_V - safe_V) for at_s, put_V in loop.put_out if at_s >= since_s]
    assert away_V, f"{said}: no voltage was written"
    assert away_V == sorted(away_V, reverse=True), f"{said}: the ramp turned back: {away_V}"
    assert away_V[-1] == 0.0, f"{said}: {away_V[-1]} V away from the safe voltage"
