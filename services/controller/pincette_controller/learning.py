"""Iterative learning over the cycles of a program's path, at full amplitude, during the motion."""

from msgspec.structs import replace

from pincette.control.planning.paths import Path
from pincette.control.planning.program import Program
from pincette.control.planning.repetition import CycleLearner, cycle_ticks
from pincette.control.planning.segments import Segment, Track
from pincette.control.record import FrozenRecord
from pincette.core.messages.arms import ArmEstimate
from pincette_controller.player_state import Player


class Learning(FrozenRecord, frozen=True):
    """Corrections learned so far, and the correction of x_r at the coming sample."""

    learner: CycleLearner | None
    """Learner of the cycles; None if the program learns nothing."""
    correction_um: float = 0.0


def begin_learning(program: Program, arms: int) -> Learning:
    """Begin with the corrections of the program; two arms learn nothing."""
    known = program.corrections if arms == 1 else None
    return Learning(None if known is None else CycleLearner(known))


def check_cycle(program: Program, period_s: float) -> None:
    """Check that corrections fit the path's cycle; raises ValueError."""
    known = program.corrections
    if known is None:
        return
    paths = [_cyclic_path(segment) for segment in program.segments]
    cycles = [path.cycle_s for path in paths if path is not None]
    if not cycles:
        raise ValueError("the program learns, but none of its paths has cycles")
    for cycle_s in cycles:
        ticks = cycle_ticks(cycle_s, period_s)
        if len(known.values_um) != ticks:
            raise ValueError(f"{len(known.values_um)} corrections for a cycle of {ticks} ticks")


def learn(learning: Learning, before: Player, estimate: ArmEstimate, period_s: float) -> Learning:
    """Update the learner with x - x_r of the newest sample; x_r is from the previous tick."""
    if learning.learner is None:
        return learning
    path = _cyclic_path(before.segment)
    if path is None:
        return learning
    t_s, slack_s = before.ticks * period_s, 0.5 * period_s
    if not path.full_from_s - slack_s <= t_s < path.full_to_s - slack_s:
        return learning
    learner = learning.learner.updated(
        before.ticks,
        estimate.x_um - before.ref.x_um,
        limited=bool(estimate.limits_active) or before.pause.active,
    )
    return replace(learning, learner=learner)


def correct(learning: Learning, player: Player, period_s: float) -> Learning:
    """Update the correction of the next x_r; it is blended in and out with the path."""
    if learning.learner is None:
        return learning
    path = _cyclic_path(player.segment)
    if path is None or player.ended:
        return replace(learning, correction_um=0.0) if learning.correction_um else learning
    share = path.share(player.ticks * period_s)
    value_um = share * learning.learner.corrections.at(player.ticks)
    return replace(learning, correction_um=value_um)


def _cyclic_path(segment: Segment) -> Path | None:
    """Return the path of the force if it has cycles; None otherwise."""
    path = segment.force if isinstance(segment, Track) else None
    return None if path is None or path.knots else path
