"""One fault in a job: a program of the loop is killed or stopped, the actuator reacts, a person
resets it."""

import random
import signal
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from time import monotonic, sleep

from pincette.core.messages import Applied, GroundTruth, Position
from pincette.core.topics import LOOP
from tests.support.distributions import Injected
from tests.support.grips import hold, kill, make_ready, move_away, restart, wait_for_any_phase
from tests.support.namespaces import Cut, Way
from tests.support.reactions import REACTION_S, SAFE_S, TRIPPED, await_reaction
from tests.support.rigs import Tree, output_step_V
from tests.support.ringing import residual
from tests.support.running import RunningRig
from tests.support.stalls import StallRecorder
from tests.support.witness import Witness

CUTS: dict[str, Way] = {"cut off": "both", "mute": "out", "deaf": "in"}
"""Kinds of cuts: all packets are lost, those from the program, or those to it."""
WAKES_S = (0.15, 0.8)
"""A program that hangs, or is cut off, comes back while a held part is still frozen and its links
are still kept, or when the actuator is latched and Zenoh has given the links up."""
LOOK_S = 0.1
"""Time for which a recovered rig is watched before it is reset, in s."""
BEFORE_PERIODS = 5
"""Number of periods before the fault from which the voltages are checked."""
WATCHDOG_S, TICK_S, IDLE_S = 0.5, 0.1, 0.05
"""Step of the output module by its manual, and the interval at which the simulated one checks
it."""
WATCHED: Tree = {"output": {"options": {"watchdog_s": WATCHDOG_S}}}
MODULE_S = WATCHDOG_S + TICK_S + IDLE_S


@dataclass(frozen=True, slots=True)
class Fault:
    """Fault of a program, and whether a part is held at that time."""

    kind: str
    """``killed``, ``stopped``, or one of ``CUTS``."""
    program: str
    held: bool

    @property
    def name(self) -> tuple[str, str, str]:
        """Return a description: fault, program, part."""
        return self.kind, self.program, "held" if self.held else "free"


def inject(
    rig: RunningRig, seen: Witness, stalls: StallRecorder, fault: Fault, chance: random.Random
) -> Injected:
    """Cause a fault of a program at any phase of a period, check the reaction, and make the rig
    ready.

    Raises
    ------
    AssertionError
        If a rule without a time limit is broken: the course of the voltage, a command that is
        accepted after the trip, a cause without a text, or a motion before a reset.
    TimeoutError
        If the rig does not become safe, or ready.
    """
    job = hold(rig, seen) if fault.held else move_away(rig, seen)
    strike, heal = _harm(rig, fault)
    wait_for_any_phase(chance, rig.rig.rig.period_s)
    try:
        struck_s = strike()
        _wait_out(rig, seen, fault, struck_s, chance)
    finally:
        heal()
    if fault.program == "actuator":
        injected = _left_to_the_module(rig, seen, stalls, fault, struck_s)
    else:
        injected = _reacted(rig, seen, stalls, fault, struck_s)
    _check_words(rig, job, fault)
    _check_nothing_moves(rig, seen, fault, struck_s)
    make_ready(rig)
    return injected


def _harm(rig: RunningRig, fault: Fault) -> tuple[Callable[[], float], Callable[[], None]]:
    """Return a function that causes the fault and returns its time, and one that undoes it."""
    if fault.kind == "killed":
        return partial(kill, rig, fault.program), partial(restart, rig, fault.program)
    if fault.kind == "stopped":

        def stop() -> float:
            now = monotonic()
            rig.fleet.signal(fault.program, signal.SIGSTOP)
            return now

        return stop, partial(rig.fleet.signal, fault.program, signal.SIGCONT)
    port = rig.rig.bus.port
    process = rig.fleet.members[fault.program].process.pid
    cut = Cut(process, range(port, port + 1 + len(LOOP)), CUTS[fault.kind])
    return cut.strike, cut.heal


def _safe(rig: RunningRig, seen: Witness, since_s: float) -> float:
    """Return when the instrument first output the safe voltage."""
    step_V, safe_V = output_step_V(rig.rig), rig.rig.safety.safe_V
    return seen.until(
        GroundTruth, lambda truth: abs(truth.arms[0].voltage_V - safe_V) <= step_V, since_s
    )[0]


def _wait_out(
    rig: RunningRig, seen: Witness, fault: Fault, struck_s: float, chance: random.Random
) -> None:
    """Wait until the program is to return; starting it earlier would take CPU time from the
    reacting programs."""
    if fault.kind == "killed":
        _safe(rig, seen, struck_s)
        sleep(LOOK_S)
    else:
        sleep(chance.choice(WAKES_S))


def _reacted(
    rig: RunningRig, seen: Witness, stalls: StallRecorder, fault: Fault, struck_s: float
) -> Injected:
    """Return the reaction of the actuator."""
    reaction = await_reaction(rig.rig, seen, stalls, struck_s, held=fault.held)
    ramp = seen.since(GroundTruth, struck_s - BEFORE_PERIODS * rig.rig.rig.period_s)
    ringing_um, way_um = residual(rig.rig, ramp)
    return Injected(
        *fault.name,
        phase=_phase(rig, seen, struck_s),
        reaction_s=reaction.reaction_s,
        reaction_limit_s=REACTION_S,
        reaction_stalls_s=reaction.reaction_stalls_s,
        safe_s=reaction.safe_s,
        safe_limit_s=SAFE_S + (rig.rig.safety.freeze_s if fault.held else 0.0),
        safe_stalls_s=reaction.safe_stalls_s,
        ringing=ringing_um / way_um,
        ringing_um=ringing_um,
        cause=reaction.cause,
    )


def _left_to_the_module(
    rig: RunningRig, seen: Witness, stalls: StallRecorder, fault: Fault, struck_s: float
) -> Injected:
    """Check the case that the actuator itself has died: only the module's watchdog reacts, with
    one step."""
    safe_at = _safe(rig, seen, struck_s)
    stood_s = stalls.between(struck_s, safe_at)
    return Injected(
        *fault.name,
        phase=_phase(rig, seen, struck_s),
        reaction_s=None,
        reaction_limit_s=None,
        reaction_stalls_s=0.0,
        safe_s=safe_at - struck_s,
        safe_limit_s=MODULE_S,
        safe_stalls_s=stood_s,
        ringing=None,
        ringing_um=None,
        cause="",
    )


def _phase(rig: RunningRig, seen: Witness, struck_s: float) -> float:
    """Return the phase of the fault within a period, from the newest sample before it."""
    period_s = rig.rig.rig.period_s
    came_s = [at for at, _ in seen.since(Position, struck_s - 1.0) if at <= struck_s]
    return ((struck_s - came_s[-1]) / period_s) % 1.0


def _check_words(rig: RunningRig, job: str, fault: Fault) -> None:
    """Check that the job has failed with a cause that an operator can read."""
    ended = rig.ended(job)
    assert ended["state"] == "failed", ended["state"]
    if fault.program == "actuator":
        assert "actuator" in ended["cause"], ended["cause"]
    else:
        assert "command_age" in ended["cause"], ended["cause"]
    if fault.kind == "killed":
        assert fault.program in ended["cause"], ended["cause"]


def _check_nothing_moves(rig: RunningRig, seen: Witness, fault: Fault, struck_s: float) -> None:
    """Check that no command is accepted and nothing is armed, whatever a returning program
    sends."""
    if fault.program == "actuator":
        since_s = struck_s + rig.rig.rig.period_s
    else:
        since_s, _ = seen.until_state(TRIPPED, struck_s)
    sleep(LOOK_S)
    echoes = [echo for _, echo in seen.since(Applied, since_s)]
    assert not [echo for echo in echoes if echo.answered], "a command was accepted after the trip"
    states = {echo.state for echo in echoes}
    assert states <= {*TRIPPED, "latched"}, states
    assert not rig.view()["can_start"]
