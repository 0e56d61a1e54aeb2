"""Actions on a program that plays, from the request to the tick in which they act.

A person asks for them, or the lease that the supervisor has granted ends: it says how long a
program plays on while nothing is heard of the supervisor. It is counted on the clock that the step
is given. Its end is an action that is logged as a request, so that a replay, which has no such
clock, finds it in the record.
"""

from collections.abc import Sequence

from msgspec.structs import replace

from pincette.control.planning.program import Program, Segment
from pincette.control.record import FrozenRecord
from pincette.core.faults import Acted, ActionCode, FaultCode, Outcome, Phase, fault
from pincette.core.messages import Action, Lease
from pincette_controller.guarding import STOP_S
from pincette_controller.player_state import Player, enter, follow, has_phase, jump

ON_ITS_WAY = (Outcome.NONE, Outcome.GRIPPED, Outcome.TRACKED, Outcome.MOVED)
"""Outcomes of a program that goes as planned so far."""


class RunningLease(FrozenRecord, frozen=True):
    """A lease that runs, and the time at which it was granted last."""

    lease: Lease
    heard_s: float


def stop(player: Player) -> Player:
    """Hold a part at the present F_r; without one, bring x_r to rest and end."""
    # Out of a pause nothing moves, and neither does it where nothing is known of the contact.
    resting, open_loop = player.paused, player.segment.open_loop
    law, speed = player.segment.law, 0.0 if resting else player.speed_um_per_s
    player = replace(
        player,
        outcome=Outcome.STOPPED,
        pausing=False,
        paused=False,
        speed_um_per_s=speed,
        ends_after="",
    )
    if player.held:
        if player.contact_x_um is None or (resting and open_loop):
            return enter(player, -1, Segment(Phase.HOLD, "voltage", None))
        force_mN = None if resting else player.force_r_mN
        rest = Segment(Phase.HOLD, "force", None, force_to_mN=force_mN, move_s=STOP_S, law=law)
        return enter(player, -1, rest)
    x_to_um, stop_s = _rest(player, speed)
    rest = Segment(Phase.STOPPING, "free", stop_s, x_to_um=x_to_um, law=law)
    return enter(replace(player, zeroing=False), -1, rest)


def _rest(player: Player, speed_um_per_s: float) -> tuple[float, float]:
    """Where a free arm comes to rest that is stopped, and in what time: never nearer to a part.

    It slows down over v·t/2, but not beyond where its segment leads. A seek may touch at any
    sample: its arm goes back to where the seek began, where it was free.
    """
    x_um, to_um = player.x_r_um, player.segment.x_to_um
    if player.segment.kind == "seek":
        return player.from_x_um, STOP_S
    way_um = 0.5 * STOP_S * speed_um_per_s
    left_um = 0.0 if to_um is None else to_um - x_um
    if player.segment.kind != "free" or way_um * left_um <= 0.0 or abs(way_um) <= abs(left_um):
        return x_um + way_um, STOP_S
    return x_um + left_um, 2.0 * left_um / speed_um_per_s


def let_go(program: Program, player: Player) -> Player:
    """Stop, with a held part unloaded, where the arm is then."""
    if not player.held:
        return stop(player)
    return release(program, replace(player, outcome=Outcome.STOPPED, ends_after=Phase.UNLOAD))


def retract(program: Program, player: Player) -> Player:
    """Stop, with a held part unloaded, and go back where the program has a retreat."""
    if player.held:
        return release(program, replace(player, outcome=Outcome.STOPPED, ends_after=""))
    if not has_phase(program, Phase.RETREAT):
        return stop(player)
    speed = 0.0 if player.paused else player.speed_um_per_s
    player = replace(player, outcome=Outcome.STOPPED, zeroing=False, speed_um_per_s=speed)
    return jump(program, player, Phase.RETREAT, player.x_r_um)


def release(program: Program, player: Player) -> Player:
    """Go on with the unload, from wherever a part is held."""
    return jump(program, player, Phase.UNLOAD, player.x_r_um)


def keep(player: Player) -> Player:
    """End with the part held; the voltage stays as it is applied."""
    return replace(player, outcome=player.outcome or Outcome.STOPPED, ended=True, paused=False)


def may_keep(player: Player) -> bool:
    """Whether a part is held, and nothing moves."""
    return player.held and (player.paused or player.segment.phase == Phase.HOLD)


def waits(player: Player) -> bool:
    """Whether the program waits for the action ``continue``; one that holds waits for another."""
    endless = player.segment.kind == "voltage" and player.segment.duration_s is None
    return endless and not player.held and not player.paused


def pause(player: Player) -> Player:
    """Request a pause; one that has begun goes on."""
    return player if player.paused else replace(player, pausing=True)


def resume(player: Player) -> Player:
    """Go on with the segment's time where it stood, or withdraw the request."""
    return replace(player, pausing=False, paused=False, resumed=player.paused)


def action_objection(pending: Sequence[Action], player: Player | None, action: ActionCode) -> str:
    """Why a program that plays does not take an action, beside those pending; empty: it does."""
    held = player is not None and player.held
    paused = player is not None and player.paused
    outcome = Outcome.NONE if player is None else player.outcome
    if action == ActionCode.PAUSE and outcome not in ON_ITS_WAY:
        return f"the program is not on its way any more ({outcome}): pause has nothing to act on"
    if action == ActionCode.RESUME:
        asked = any(other.action == ActionCode.PAUSE for other in pending)
        pausing = player is not None and player.pausing
        if not (asked or pausing or paused):
            return "the program is not paused: resume has nothing to go on with"
    if action == ActionCode.RELEASE and not held:
        return "no part is held: release has nothing to let go"
    if action == ActionCode.KEEP and (player is None or not may_keep(player)):
        return "no part is held at rest: keep has nothing to keep"
    if action == ActionCode.CONTINUE and paused:
        return "the program is paused: resume it first"
    if action == ActionCode.CONTINUE and (player is None or not waits(player)):
        return "the program waits for nobody: continue has nothing to go on with"
    return ""


def act(
    program: Program, player: Player, pending: Sequence[Action], seq: int, x_um: float
) -> tuple[Player, tuple[Action, ...], list[Acted]]:
    """Player after the actions whose seq has come, those for later, and what acted but a pause."""
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
            player = follow(program, player, x_um) if waits(player) else player
            return player, Acted.CONTINUE
        case ActionCode.KEEP if may_keep(player):
            return keep(player), None
        case ActionCode.RELEASE if player.held:
            return release(program, player), Acted.RELEASE
        case _:
            return player, None


def acted_in_tick(acted: Sequence[Acted], before: Player, after: Player) -> tuple[Acted, ...]:
    """What telemetry reports as having acted; ``before`` is the player at the start of the tick."""
    begun = after.paused and (not before.paused or Acted.RESUME in acted)
    return (*acted, Acted.PAUSE) if begun else tuple(acted)


def lease_objection(lease: Lease, epoch: int, *, playing: bool, ended: bool) -> str:
    """Why a lease is not granted in this epoch, whose lease may have ended; empty where it is."""
    if lease.epoch != epoch:
        return f"lease of epoch {lease.epoch}, the controller is in {epoch}"
    if not playing:
        return "nothing plays: a lease has nothing to go on with"
    if ended:
        return "the lease of this epoch has ended: arm anew"
    if lease.length_s <= 0.0:
        return f"lease of {lease.length_s:g} s: not above 0 s"
    return ""


def lease_end(running: RunningLease, outcome: Outcome, now: float) -> Action | None:
    """How a program is stopped whose lease has ended; None where it runs, or nothing is to do."""
    if outcome == Outcome.STOPPED:  # there is nothing left to stop
        return None
    silent_s, length_s = now - running.heard_s, running.lease.length_s
    if silent_s <= length_s:
        return None
    reason = fault(FaultCode.LEASE_ENDED, silent_s=silent_s, limit_s=length_s)
    return Action(ActionCode(running.lease.then), reason=reason)
