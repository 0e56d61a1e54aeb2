"""How long a job may be in a state; pure."""

from pincette.api.states import STATES, JobState
from pincette.config import RigFile
from pincette_supervisor.planning.planned import Planned

LETTING_GO = ("unload", "release", "retreat")
"""Phases that a stop plays where ``on_stop`` lets go of the part."""


def limit_s(state: JobState, planned: Planned | None, rig: RigFile, on_stop: str) -> float | None:
    """Time in s after which a state has taken too long; None where it may last.

    A program without an end plays as long as it is let, but its pause must come.
    """
    row = STATES[state]
    if row.deadline_s is None:
        return None
    if row.beyond == "" or planned is None:
        return row.deadline_s
    if row.beyond == "freeze":
        return row.deadline_s + rig.safety.freeze_s + rig.safety.ramp_s
    if row.beyond == "letting_go":
        return row.deadline_s + (0.0 if on_stop == "hold" else _letting_go_s(planned))
    if state == "running" and planned.planned_s is None:
        return None
    return row.deadline_s + planned.plan.duration_s


def _letting_go_s(planned: Planned) -> float:
    return sum(item.duration_s or 0.0 for item in planned.plan.phases if item.phase in LETTING_GO)
