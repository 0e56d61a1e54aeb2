"""State of the actuator and the part, with their certainty by the age of the last message.

A state received within ``Health.sensor_limit_s`` is ``known``. An older state is ``believed``,
until the output may have released the part by its own watchdog; after that nothing is known of a
held part. A frozen or an idle actuator writes nothing, so nothing confirms the part that it holds:
that part is ``believed``. In lockstep, time is not that of the wall clock: only the actuator's
token counts.
"""

from math import inf
from statistics import fmean
from typing import NamedTuple

from pincette.api.rig_states import PART, Certainty, PartState, ReportedPart, RigState
from pincette.api.rigs import Standing
from pincette.core.faults import FaultCode, Mode
from pincette.core.messages import Applied, Estimate
from pincette.core.messages.arms import ArmEstimate
from pincette_supervisor.alarms import output_lost
from pincette_supervisor.plugin import Present
from pincette_supervisor.rigs.rig_context import RigContext

PLAYING_S = 1.0
"""Age of the newest sample from which a program no longer counts as playing, in s."""


class Limits(NamedTuple):
    """Ages in s up to which a state is known, and beyond which it is unknown."""

    known_s: float
    lets_go_s: float

    def certainty(self, age_s: float) -> Certainty:
        """Return the certainty of a state of this age."""
        if age_s <= self.known_s:
            return "known"
        return "believed" if age_s <= self.lets_go_s else "unknown"


def standing(context: RigContext) -> Standing:
    """Return the state of the actuator and of the part, each with its certainty and age."""
    limits = Limits(context.health.sensor_limit_s(), context.health.lets_go_s)
    message_age_s = _message_age_s(context)
    state, certainty = _state(context, limits, message_age_s)
    part, part_certainty = _part(context, limits, message_age_s)
    return Standing(
        state=state,
        state_certainty=certainty,
        state_age_s=message_age_s,
        part=part,
        part_certainty=part_certainty,
        part_age_s=_part_age_s(context, message_age_s),
    )


def _message_age_s(context: RigContext) -> float | None:
    """Return the age of the actuator's last sample or reply, in s; None if it never sent one.

    In lockstep, it is 0 s as long as its token is present.
    """
    observer, health = context.observer, context.health
    if context.rig.lockstep and observer.alive("actuator"):
        return 0.0
    ages_s = (observer.age_s(Applied), health.actuator_answer_age_s())
    return min((age_s for age_s in ages_s if age_s is not None), default=None)


def _state(
    context: RigContext, limits: Limits, message_age_s: float | None
) -> tuple[RigState, Certainty]:
    """Return the actuator's state; after its disappearance, the state is unknown."""
    shown = context.health.state
    if shown == "unknown" or message_age_s is None:
        return "unknown", "unknown"
    certainty = limits.certainty(message_age_s)
    if certainty == "believed" and not context.observer.alive("actuator"):
        certainty = "unknown"
    return (shown if certainty != "unknown" else "unknown"), certainty


def _part(
    context: RigContext, limits: Limits, message_age_s: float | None
) -> tuple[PartState, Certainty]:
    """Return the state of the part by the actuator's newest sample, and the certainty of that
    state.

    An actuator that replaced one with a held part does not know of that part.
    """
    applied = context.observer.newest(Applied)
    if applied is None:
        return "unknown", "unknown"
    reported: ReportedPart = "held" if applied.part_held else "none"
    age_s = inf if message_age_s is None else message_age_s
    reason = context.health.latch().reason
    if reported == "none" and context.health.earlier_held():
        return "unknown", "unknown"
    if reported == "held" and output_lost(reason):
        lost_s = context.observer.trips.lost_s(reason)
        age_s = max(age_s, inf if lost_s is None else lost_s)
    certainty = PART[context.health.state][reported][limits.certainty(age_s)]
    return ("unknown" if certainty == "unknown" else reported), certainty


def _part_age_s(context: RigContext, message_age_s: float | None) -> float | None:
    """Return the age of the last confirmed voltage if a part is held, otherwise of the actuator's
    last message, in s.
    """
    applied = context.observer.newest(Applied)
    if context.rig.lockstep or applied is None or not applied.part_held:
        return message_age_s
    return context.observer.confirmed_s()


def is_playing(context: RigContext) -> bool:
    """Return whether a program plays, by the actuator's samples; before the first, by its reply.

    The reply counts for a short time only: if a supervisor was killed before it had armed the
    sensor, the actuator stays armed in lockstep, and nothing plays.
    """
    silent_s = context.observer.silent_s(Applied)
    if silent_s is None:
        actuator = context.health.status("actuator")
        armed = actuator is not None and actuator.mode == Mode.ARMED
        return armed and context.observer.listened_s() < PLAYING_S
    return context.health.latch().mode == Mode.ARMED and silent_s < PLAYING_S


def present(context: RigContext) -> Present | None:
    """Return the present state of the rig; None if nothing is known of it."""
    applied = context.observer.newest(Applied)
    if applied is None:
        return None
    position = context.observer.standing()
    measured = () if position is None else position.arms
    x_um = measured[0].x_um if measured else None
    second = measured[1] if len(measured) > 1 else None
    known = standing(context).part
    pressing = _pressing(context, applied) if known == "held" else ()
    return Present(
        applied.arms[0].voltage_V,
        x_um,
        None if known == "unknown" else known == "held",
        second_V=applied.arms[1].voltage_V if len(applied.arms) > 1 else None,
        second_um=second.x_um if second is not None and second.valid else None,
        memory_known=memory_known(context),
        stroke=next(iter(context.health.findings("estimator", FaultCode.MODEL_MISMATCH)), None),
        force_mN=fmean(arm.force_mN for arm in pressing) if pressing else None,
        force_uncertainty_mN=max((arm.force_uncertainty_mN for arm in pressing), default=None),
    )


def _pressing(context: RigContext, applied: Applied) -> tuple[ArmEstimate, ...]:
    """Return the newest forces in the epoch of a voltage; empty if an arm has no zero."""
    estimate = context.observer.newest(Estimate)
    if estimate is None or estimate.epoch != applied.epoch or not estimate.valid:
        return ()
    if any(arm.zero_age_s is None for arm in estimate.arms):
        return ()
    return estimate.arms


def memory_known(context: RigContext) -> bool | None:
    """Return whether the estimator knows the history of the hysteresis; None if it does not
    reply."""
    if context.health.status("estimator") is None:
        return None
    return not context.health.findings("estimator", FaultCode.MEMORY_UNKNOWN)
