"""Whether the stage that carries the gripper may move: the arm at rest, and the force steady."""

from typing import cast

from pincette.api.rig_models import SafeToMove
from pincette.messages import Estimate, Telemetry
from pincette.topics import ESTIMATE, TELEMETRY
from pincette_supervisor.running.job import LiveJob
from pincette_supervisor.running.part import PLAYING_S
from pincette_supervisor.running.site import Site

STEADY_SIGMAS = 3.0
"""A force within so many of its standard uncertainties of its reference is steady."""
ABOUT_TO = ("preparing", "resuming")


def safe_to_move(site: Site, active: LiveJob | None) -> SafeToMove:
    """Judge by the newest samples; what is not known is not safe."""
    reason = _unsafe(site, active)
    return SafeToMove(value=not reason, reasons=[reason] if reason else [])


def _unsafe(site: Site, active: LiveJob | None) -> str:
    state, cause = site.health.latch()
    if state == "unknown":
        return "the actuator has not said how it is"
    if state == "ramping":
        return f"the actuator ramps to its safe voltage ({cause})"
    if state == "frozen":
        hold_s = site.rig.safety.freeze_s
        return f"the actuator is frozen ({cause}) and ramps {hold_s:g} s after the fault"
    if latched := site.health.latched():
        return f"the actuator is latched ({latched}): see where the part is, then reset it"
    if active is not None and active.state in ABOUT_TO:
        return f"job {active.id} is {active.state}"
    if state != "armed":
        return ""
    return _unrest(site)


def _unrest(site: Site) -> str:
    """Why an arm that is led by a program is not at rest."""
    telemetry = cast("Telemetry | None", site.observer.newest(TELEMETRY))
    age_s = site.observer.age_s(TELEMETRY)
    if telemetry is None or age_s is None or age_s > PLAYING_S:
        return "the controller has not said where the program is"
    if not telemetry.paused and telemetry.phase != "hold":
        return f"the arm moves: {telemetry.phase}"
    estimate = cast("Estimate | None", site.observer.newest(ESTIMATE))
    if estimate is None or not estimate.valid:
        return "the force is not known"
    if not telemetry.held or estimate.zero_age_s is None:
        return ""
    error_mN = abs(estimate.force_mN - telemetry.force_r_mN)
    limit_mN = STEADY_SIGMAS * estimate.force_uncertainty_mN
    if error_mN > limit_mN:
        return f"the force is {error_mN:.2f} mN off its reference, limit {limit_mN:.2f} mN"
    return ""
