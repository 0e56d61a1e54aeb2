"""Actions from the question that asks for them to the tick in which they act."""

from collections.abc import Sequence

from pincette.control.planning.program import Program
from pincette.messages import Act
from pincette_controller import actions
from pincette_controller.pausing import pause, resume
from pincette_controller.playing import Player

ACTIONS = ("stop", "let_go", "retract", "pause", "resume", "release", "continue", "keep")
ON_ITS_WAY = ("", "gripped", "tracked", "moved")
"""Outcomes of a program that goes as planned so far."""


def objection(wishes: Sequence[Act], player: Player | None, action: str) -> str:
    """Why an action is not taken by a program that plays; empty where it is.

    Parameters
    ----------
    wishes
        Actions that are to act yet.
    player
        None before the first sample.
    """
    held = player is not None and player.held
    paused = player is not None and player.paused
    outcome = "" if player is None else player.outcome
    if action not in ACTIONS:
        return f"no action {action!r}; there are {', '.join(ACTIONS)}"
    if action == "pause" and outcome not in ON_ITS_WAY:
        return f"the program is not on its way any more ({outcome}): pause has nothing to act on"
    if action == "resume":
        asked = any(wish.action == "pause" for wish in wishes)
        pausing = player is not None and player.pausing
        if not (asked or pausing or paused):
            return "the program is not paused: resume has nothing to go on with"
    if action == "release" and not held:
        return "no part is held: release has nothing to let go"
    if action == "keep" and (player is None or not actions.may_keep(player)):
        return "no part is held at rest: keep has nothing to keep"
    if action == "continue" and paused:
        return "the program is paused: resume it first"
    if action == "continue" and (player is None or not actions.waits(player)):
        return "the program waits for nobody: continue has nothing to go on with"
    return ""


def act(
    program: Program, player: Player, wishes: Sequence[Act], seq: int, x_um: float
) -> tuple[Player, tuple[Act, ...], list[str]]:
    """Let the actions act whose seq has come: the player, those for later, and what acted.

    A pause is not among those: it acts where the references rest.
    """
    acted: list[str] = []
    later: list[Act] = []
    for wish in wishes:
        if wish.at_seq is not None and wish.at_seq > seq:
            later.append(wish)
            continue
        player, word = _done(program, player, wish.action, x_um)
        if word and wish.reason:
            acted.append(wish.reason.partition(":")[0])
        if word:
            acted.append(word)
    return player, tuple(later), acted


def _done(program: Program, player: Player, action: str, x_um: float) -> tuple[Player, str]:
    match action:
        case "stop":
            return actions.stop(player), "stop"
        case "let_go":
            return actions.let_go(program, player), "stop"
        case "retract":
            return actions.retract(program, player), "stop"
        case "pause":
            return pause(player), ""
        case "resume":
            return resume(player), "resume"
        case "continue":
            return actions.proceed(program, player, x_um), "continue"
        case "keep" if actions.may_keep(player):
            return actions.keep(player), ""
        case "release" if player.held:
            return actions.release(program, player), "release"
        case _:
            return player, ""


def told(acted: Sequence[str], before: Player, after: Player) -> str:
    """What telemetry says has acted; ``before`` is the player as the tick found it."""
    begun = after.paused and (not before.paused or "resume" in acted)
    return " ".join((*acted, "pause") if begun else acted)
