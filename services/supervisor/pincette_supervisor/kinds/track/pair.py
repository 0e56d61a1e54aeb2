"""Plan of a track with two arms: place and force follow a path each."""

from typing import Any, Literal

from pincette.config import RigFile
from pincette.control.planning.pair_plan import PairPaths, track_program
from pincette.control.planning.path_shapes import peaks
from pincette.control.planning.paths import Path, Shape
from pincette_supervisor.kinds.track import ForcePath, PlacePath, TrackJobRequest
from pincette_supervisor.kinds.track.path import LONGEST_S, shaped_path
from pincette_supervisor.plugin import FaultyRequestError, ModelInUse, Planned, Present
from pincette_supervisor.plugin.plans import (
    STARTS_UM,
    contacts_um,
    homes_um,
    most_mN,
    pair_job,
    pair_request,
    pair_values,
)

MEMBERS = {
    "sinusoid": ("mean", "pp", "frequency_hz", "cycles"),
    "triangle": ("mean", "pp", "frequency_hz", "cycles"),
    "step": ("levels", "dwell_s"),
    "waypoints": ("points",),
}
POINTERS = {"load": "/force", "settle": "/place", "track": "", "unload": "/force"}


def plan_pair(request: TrackJobRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan a track with two arms."""
    rig = model.rig
    if request.force is None and request.place is None:
        raise FaultyRequestError(
            "", "a track with two arms wants a path: give force, place or both"
        )
    values = pair_values(request, rig)
    first, second = contacts_um(rig)
    force = None if request.force is None else _force_path(request.force, rig)
    place = None if request.place is None else _place_path(request.place, rig, first - second)
    force_mN = request.force_mN or rig.grip.force_mN
    paths = PairPaths(force=force, place=place)
    made = pair_request(values, rig, force_mN, centred=request.centre)
    highest_mN = force_mN if force is None else max(force_mN, peaks(force).highest)
    homes = homes_um(rig, made, highest_mN)
    program = track_program(made, paths, STARTS_UM, most_mN(rig), homes)
    values |= {
        "force_mN": force_mN,
        "force": None if request.force is None else request.force.model_dump(),
        "place": None if request.place is None else request.place.model_dump(),
    }
    return pair_job(request, model, program, values, POINTERS, present)


def _force_path(path: ForcePath, rig: RigFile) -> Path:
    track, models = rig.track, [arm.model for arm in rig.arms]
    squeeze = sum(m.compliance_um_per_mN for m in models) + 1.0 / rig.part.stiffness_mN_per_um
    given: dict[str, Any] = {
        "mean": path.mean_mN,
        "pp": path.pp_mN,
        "frequency_hz": path.frequency_hz,
        "cycles": path.cycles,
        "levels": path.levels_mN,
        "dwell_s": path.dwell_s,
        "points": path.points and [(point.t_s, point.force_mN) for point in path.points],
    }
    usual = {
        "mean": track.force_mean_mN,
        "pp": track.force_pp_mN,
        "frequency_hz": track.frequency_hz,
        "cycles": track.cycles,
        "levels": list(track.levels_mN),
        "dwell_s": track.dwell_s,
    }
    speeds = track.rate_um_per_s / squeeze, track.acceleration_um_per_s2 / squeeze
    return _path("force", "/force", path.shape, given, usual, speeds)


def _place_path(path: PlacePath, rig: RigFile, apart_um: float) -> Path:
    track = rig.track
    given: dict[str, Any] = {
        "mean": path.mean_um,
        "pp": path.pp_um,
        "frequency_hz": path.frequency_hz,
        "cycles": path.cycles,
        "levels": path.levels_um,
        "dwell_s": path.dwell_s,
        "points": path.points and [(point.t_s, point.place_um) for point in path.points],
    }
    usual = {
        "mean": 0.5 * apart_um,
        "frequency_hz": track.frequency_hz,
        "cycles": track.cycles,
        "dwell_s": track.dwell_s,
    }
    speeds = track.rate_um_per_s, track.acceleration_um_per_s2
    return _path("position", "/place", path.shape, given, usual, speeds)


def _path(
    quantity: Literal["force", "position"],
    pointer: str,
    shape: Shape,
    given: dict[str, Any],
    usual: dict[str, Any],
    speeds: tuple[float, float],
) -> Path:
    """A path of what is given and usual; raises FaultyRequestError where it makes none."""
    members = MEMBERS[shape]
    for name, value in given.items():
        if value is not None and name not in members:
            taken = ", ".join(members)
            raise FaultyRequestError(
                pointer, f"{name} does not go with a {shape}, which takes {taken}"
            )
    values: dict[str, Any] = {
        name: usual.get(name) if given[name] is None else given[name] for name in members
    }
    missing = [name for name, value in values.items() if value is None]
    if missing:
        raise FaultyRequestError(pointer, f"a {shape} of {quantity} wants {', '.join(missing)}")
    try:
        path = shaped_path(quantity, shape, values, speeds)
    except ValueError as error:
        raise FaultyRequestError(pointer, str(error)) from error
    if path.duration_s > LONGEST_S:
        raise FaultyRequestError(
            pointer, f"the path takes {path.duration_s:g} s, limit {LONGEST_S:g} s"
        )
    return path
