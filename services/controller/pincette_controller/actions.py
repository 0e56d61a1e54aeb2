"""Actions on a running program, from the request to the tick in which they take effect.

An operator requests them, or the lease granted by the supervisor ends. The lease is the time for
which a program continues without a message of the supervisor. It is measured by the clock that is
passed to the step. The end of a lease is an action that is logged as a request, so that a replay,
which has no such clock, finds it in the record.
"""

from collections.abc import Sequence

from msgspec.structs import replace

from pincette.control.planning.program import Program
from pincette.control.planning.segments import Drive, Move, Press, Seek
from pincette.control.record import FrozenRecord
from pincette.core.faults import KEPT, Acted, ActionCode, FaultCode, Outcome, Phase, fault
from pincette.core.messages import Action, Lease
from pincette_controller.guarding import STOP_S
from pincette_controller.player_state import (
    NO_PAUSE,
    Pause,
    Player,
    enter,
    enter_next,
    has_phase,
    jump,
    with_watch,
)

ON_ITS_WAY = (
    Outcome.NONE,
    Outcome.GRIPPED,
    Outcome.TRACKED,
    Outcome.MOVED,
    Outcome.RELEASED,
)
"""Outcomes of a program that has gone as planned so far."""


class RunningLease(FrozenRecord, frozen=True):
    """A running lease, and the time at which it was last renewed."""

    lease: Lease
    heard_s: float


def stop(player: Player) -> Player:
    """Stop: hold a held part at the present F_r; without a part bring x_r to rest, and end."""
    # Nothing moves after a pause, or if the contact is not known.
    resting, open_loop = player.pause.active, player.segment.open_loop
    law, speed = player.segment.law, 0.0 if resting else player.ref.speed_um_per_s
    player = replace(
        player,
        outcome=Outcome.STOPPED,
        pause=NO_PAUSE,
        ref=player.ref._replace(speed_um_per_s=speed),
        ends_after="",
    )
    if player.held:
        phase = Phase.HOLD if player.segment.phase == Phase.HOLD else Phase.STOPPED
        if not player.contact_known or (resting and open_loop):
            return enter(player, -1, Drive(phase, None))
        force_mN = None if resting else player.ref.force_mN
        return enter(player, -1, Press(phase, None, law, to_mN=force_mN, move_s=STOP_S))
    to_um, stop_s = _rest(player, speed)
    player = with_watch(player, zeroing=False)
    return enter(player, -1, Move(Phase.STOPPING, stop_s, law, to_um=to_um))


def _rest(player: Player, speed_um_per_s: float) -> tuple[tuple[float | None, ...], float]:
    """Return the goals and the duration, in s, of a stop of free arms; no goal is nearer to the
    part.

    The arm slows down over v·t/2, but not beyond the goal of its segment. During a seek a contact
    is possible at any sample, so the arm goes back to where the seek began and it was free.
    """
    if player.felt is not None:
        return (None, None), STOP_S
    segment, x_um = player.segment, player.ref.x_um
    if isinstance(segment, Seek):
        return (player.entry.ref.x_um,), STOP_S
    way_um = 0.5 * STOP_S * speed_um_per_s
    to_um = segment.to_um[0] if isinstance(segment, Move) else None
    left_um = 0.0 if to_um is None else to_um - x_um
    if way_um * left_um <= 0.0 or abs(way_um) <= abs(left_um):
        return (x_um + way_um,), STOP_S
    return (x_um + left_um,), 2.0 * left_um / speed_um_per_s


def let_go(program: Program, player: Player) -> Player:
    """Unload a held part, then stop; the arm does not retreat."""
    if not player.held:
        return stop(player)
    return release(program, replace(player, outcome=Outcome.STOPPED, ends_after=Phase.UNLOAD))


def retract(program: Program, player: Player) -> Player:
    """Stop, unload a held part, and go back if the program has a retreat."""
    if player.held:
        return release(program, replace(player, outcome=Outcome.STOPPED, ends_after=""))
    if not has_phase(program, Phase.RETREAT):
        return stop(player)
    ref = player.ref._replace(speed_um_per_s=0.0) if player.pause.active else player.ref
    player = replace(with_watch(player, zeroing=False), outcome=Outcome.STOPPED, ref=ref)
    return jump(program, player, Phase.RETREAT, ref.x_um)


def release(program: Program, player: Player) -> Player:
    """Jump to the unload from any phase in which a part is held."""
    return jump(program, player, Phase.UNLOAD, player.ref.x_um)


def keep(player: Player) -> Player:
    """End with the part held; the applied voltage stays."""
    return replace(player, outcome=player.outcome or Outcome.STOPPED, ended=True, pause=NO_PAUSE)


def may_keep(player: Player) -> bool:
    """Return whether a part is held at rest."""
    return player.held and (player.pause.active or player.segment.phase in KEPT)


def waits(player: Player) -> bool:
    """Return whether the program waits for ``continue``; a hold waits for another action."""
    endless = isinstance(player.segment, Drive) and player.segment.duration_s is None
    return endless and not player.held and not player.pause.active


def pause(player: Player) -> Player:
    """Request a pause; an active pause continues."""
    if player.pause.active:
        return player
    return replace(player, pause=replace(player.pause, requested=True))


def resume(player: Player) -> Player:
    """Continue the segment from its paused time, or withdraw a request for a pause."""
    return replace(player, pause=Pause(over=player.pause.active))


def action_objection(pending: Sequence[Action], player: Player | None, action: ActionCode) -> str:
    """Return why a program rejects an action, given the pending ones; empty if it accepts it."""
    held = player is not None and player.held
    paused = player is not None and player.pause.active
    outcome = Outcome.NONE if player is None else player.outcome
    if action == ActionCode.PAUSE and outcome not in ON_ITS_WAY:
        return f"the program has ended ({outcome}): it cannot be paused"
    if action == ActionCode.RESUME:
        pause_requested = any(other.action == ActionCode.PAUSE for other in pending)
        pausing = player is not None and player.pause.requested
        if not (pause_requested or pausing or paused):
            return "the program is not paused: it cannot be resumed"
    if action == ActionCode.RELEASE and not held:
        return "no part is held: none can be released"
    if action == ActionCode.KEEP and (player is None or not may_keep(player)):
        return "no part is held at rest: none can be kept"
    if action == ActionCode.CONTINUE and paused:
        return "the program is paused: resume it first"
    if action == ActionCode.CONTINUE and (player is None or not waits(player)):
        return "the program does not wait for a person: it cannot be continued"
    return ""


def act(
    program: Program, player: Player, pending: Sequence[Action], seq: int, x_um: float
) -> tuple[Player, tuple[Action, ...], list[Acted]]:
    """Perform all due actions; return the player, the later actions, and the performed ones
    except a pause."""
    acted: list[Acted] = []
    later: list[Action] = []
    for request in pending:
        if request.at_seq is not None and request.at_seq > seq:
            later.append(request)
            continue
        player, done = _done(program, player, request.action, x_um)
        if done is None:
            continue
        if request.reason is not None:
            acted.append(Acted.LEASE)
        acted.append(done)
    return player, tuple(later), acted


def _done(
    program: Program, player: Player, action: ActionCode, x_um: float
) -> tuple[Player, Acted | None]:
    match action:
        case ActionCode.STOP:
            return stop(player), Acted.STOP
        case ActionCode.LET_GO:
            return let_go(program, player), Acted.STOP
        case ActionCode.RETRACT:
            return retract(program, player), Acted.STOP
        case ActionCode.PAUSE:
            return pause(player), None
        case ActionCode.RESUME:
            return resume(player), Acted.RESUME
        case ActionCode.CONTINUE:
            player = enter_next(program, player, x_um) if waits(player) else player
            return player, Acted.CONTINUE
        case ActionCode.KEEP if may_keep(player):
            return keep(player), None
        case ActionCode.RELEASE if player.held:
            return release(program, player), Acted.RELEASE
        case _:
            return player, None


def acted_in_tick(acted: Sequence[Acted], before: Player, after: Player) -> tuple[Acted, ...]:
    """Return the action that telemetry reports for this tick.

    ``before`` is the player at the start of the tick.
    """
    begun = after.pause.active and (not before.pause.active or Acted.RESUME in acted)
    return (*acted, Acted.PAUSE) if begun else tuple(acted)


def lease_objection(lease: Lease, epoch: int, *, playing: bool, ended: bool) -> str:
    """Return why a lease is not granted in this epoch; empty if it is granted."""
    if lease.epoch != epoch:
        return f"lease of epoch {lease.epoch}, the controller is in {epoch}"
    if not playing:
        return "no program runs: its lease cannot be renewed"
    if ended:
        return "the lease of this epoch has ended: arm again"
    if lease.length_s <= 0.0:
        return f"lease of {lease.length_s:g} s: must be above 0 s"
    return ""


def lease_end(running: RunningLease, outcome: Outcome, now: float) -> Action | None:
    """Return the action that stops a program whose lease has ended.

    Returns None if there is nothing to stop.
    """
    if outcome == Outcome.STOPPED:  # the program has been stopped already
        return None
    silent_s, length_s = now - running.heard_s, running.lease.length_s
    if silent_s <= length_s:
        return None
    reason = fault(FaultCode.LEASE_ENDED, silent_s=silent_s, limit_s=length_s)
    return Action(ActionCode(running.lease.then), reason=reason)
