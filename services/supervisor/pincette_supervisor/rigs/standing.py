"""How the actuator and the part stand, and how far that can be trusted: by when it was last heard.

What was heard within ``Health.sensor_limit_s`` is known. What is older is believed, until the
output may have let the part go by its own watchdog; from then on nothing is known of a held part. A
frozen or an idle actuator writes nothing, so nothing confirms the part that it holds: it is
believed. In lockstep time is not that of the clock on the wall: the actuator's token counts alone.
"""

from math import inf
from typing import NamedTuple

from pincette.api.rig_states import RigState
from pincette.api.rigs import Certainty, PartState, Standing
from pincette.core.faults import Mode
from pincette.core.messages import Applied
from pincette_supervisor.alarms.trips import output_lost
from pincette_supervisor.rigs.rig_context import RigContext


class Limits(NamedTuple):
    """Ages up to which something is known, and beyond which it is unknown, in s."""

    known_s: float
    lets_go_s: float

    def certainty(self, age_s: float) -> Certainty:
        """Of what was heard so long ago."""
        if age_s <= self.known_s:
            return "known"
        return "believed" if age_s <= self.lets_go_s else "unknown"


def standing(context: RigContext) -> Standing:
    """State of the actuator and of the part, each with its certainty and its age."""
    limits = Limits(context.health.sensor_limit_s(), context.health.lets_go_s)
    heard_s = _heard_s(context)
    state, certainty = _state(context, limits, heard_s)
    part, part_certainty = _part(context, limits, heard_s)
    return Standing(
        state=state,
        state_certainty=certainty,
        state_age_s=heard_s,
        part=part,
        part_certainty=part_certainty,
        part_age_s=_part_age_s(context, heard_s),
    )


def _heard_s(context: RigContext) -> float | None:
    """How long ago the actuator was heard, by its samples or its answer; None where it never was.

    In lockstep 0 s as long as its token is seen.
    """
    observer, health = context.observer, context.health
    if context.rig.lockstep and observer.alive("actuator"):
        return 0.0
    ages_s = (observer.age_s(Applied), health.actuator_answer_age_s())
    return min((age_s for age_s in ages_s if age_s is not None), default=None)


def _state(
    context: RigContext, limits: Limits, heard_s: float | None
) -> tuple[RigState, Certainty]:
    """The actuator's state; of one that has gone none is believed."""
    shown = context.health.state
    if shown == "unknown" or heard_s is None:
        return "unknown", "unknown"
    certainty = limits.certainty(heard_s)
    if certainty == "believed" and not context.observer.alive("actuator"):
        certainty = "unknown"
    return (shown if certainty != "unknown" else "unknown"), certainty


def _part(
    context: RigContext, limits: Limits, heard_s: float | None
) -> tuple[PartState, Certainty]:
    """Whether the gripper holds a part, as the actuator was last told."""
    applied, (mode, reason) = context.observer.newest(Applied), context.health.latch()
    if applied is None or mode in (None, Mode.RAMPING, Mode.LATCHED):
        return "unknown", "unknown"
    age_s = inf if heard_s is None else heard_s
    if not applied.part_held:
        # Nothing that fails grips one.
        return "none", "known" if age_s <= limits.known_s else "believed"
    if output_lost(reason):
        lost_s = context.observer.trips.lost_s(reason)
        age_s = max(age_s, inf if lost_s is None else lost_s)
    certainty = limits.certainty(age_s)
    if certainty == "unknown":
        return "unknown", "unknown"
    return "held", certainty if mode == Mode.ARMED else "believed"


def _part_age_s(context: RigContext, heard_s: float | None) -> float | None:
    """Since a voltage was last confirmed where a part is held; else since the actuator spoke."""
    applied = context.observer.newest(Applied)
    if context.rig.lockstep or applied is None or not applied.part_held:
        return heard_s
    return context.observer.confirmed_s()
