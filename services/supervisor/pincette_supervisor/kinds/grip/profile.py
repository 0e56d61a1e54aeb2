"""Which profile a grip has, and with which speeds."""

from pincette.config import RigFile, derived
from pincette.control.planning.quick_grip import (
    AskedSpeeds,
    QuickSpeeds,
    Touch,
    UsualSpeeds,
    quick_speeds,
)
from pincette.control.planning.touch_force import weak_force
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.plugin import FaultyRequestError

GENTLY = 'or grip with profile = "gentle"'


def chosen_speeds(request: GripJobRequest, rig: RigFile) -> QuickSpeeds | None:
    """Speeds of a quick grip; None where it is to be a gentle one.

    Raises
    ------
    FaultyRequestError
        Where the request asks for a quick grip and the model or the force does not allow it, or
        for a quick load in a gentle one.
    """
    profile, asked = request.profile or rig.grip.profile, request.profile == "quick"
    speeds = None if profile == "gentle" else _speeds(request, rig, asked=asked)
    if speeds is None and request.load_um_per_s is not None:
        raise FaultyRequestError(
            "/load_um_per_s",
            f"load_um_per_s = {request.load_um_per_s:g} µm/s is of a quick grip, and this is a "
            "gentle one: give load_s instead",
        )
    return speeds


def _speeds(request: GripJobRequest, rig: RigFile, *, asked: bool) -> QuickSpeeds | None:
    """Speeds of a quick grip; None where nobody asks for one and it cannot be."""
    if rig.model.free_response is None:
        if asked:
            raise FaultyRequestError(
                "/profile",
                'profile = "quick" needs an identified free response, and the model in use has '
                f"none: calibrate free_response, {GENTLY}",
            )
        return None
    touch = _touch(request, rig)
    usual = rig.grip.quick
    found = quick_speeds(
        AskedSpeeds(
            request.approach_um_per_s, request.seek_um_per_s, request.load_um_per_s, request.load_s
        ),
        UsualSpeeds(usual.approach_um_per_s, usual.seek_um_per_s, usual.load_um_per_s),
        touch,
        derived.planned_rig(rig),
    )
    if found is None and asked:
        (weak,) = weak_force(touch.force_mN, touch.contact_force_mN, "/force_mN", 0.0)
        raise FaultyRequestError("/force_mN", f"force_mN: {weak.message}")
    slow = rig.grip.seek_um_per_s
    if found is not None and not asked and request.seek_um_per_s is None:
        return found if found.seek_um_per_s >= slow else None
    return found


def _touch(request: GripJobRequest, rig: RigFile) -> Touch:
    part, grip = rig.part, rig.grip
    return Touch(
        force_mN=request.force_mN or grip.force_mN,
        contact_force_mN=request.contact_force_mN or grip.contact_force_mN,
        stiffness_mN_per_um=part.stiffness_mN_per_um,
        hardest_mN_per_um=part.stiffness_mN_per_um * (1.0 + part.stiffness_tolerance),
    )
