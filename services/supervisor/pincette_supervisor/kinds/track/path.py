"""From the members of a track request to its path."""

from collections.abc import Mapping
from typing import Any, Literal

from pincette.config import RigFile
from pincette.control.planning.path_shapes import sinusoid, steps, triangle, waypoints
from pincette.control.planning.paths import Path, Shape
from pincette_supervisor.kinds.track import MEMBERS, SWING, TrackJobRequest
from pincette_supervisor.plugin import FaultyRequestError

LIMITS = ("rate_um_per_s", "acceleration_um_per_s2")
LONGEST_S = 3600.0
POINTERS = {"step": "/levels_mN", "waypoints": "/points"}


def path_values(request: TrackJobRequest, rig: RigFile) -> dict[str, Any]:
    """The request's path completed by the rig file; raises FaultyRequestError."""
    shape = request.shape or rig.track.shape
    members = MEMBERS[shape]
    for name in sorted({*SWING, "x_pp_um", *MEMBERS["step"], *MEMBERS["waypoints"]}):
        belongs = name in members or (name == "x_pp_um" and members is SWING)
        if getattr(request, name) is not None and not belongs:
            raise FaultyRequestError(
                f"/{name}", f"{name} does not go with a {shape}, which takes {', '.join(members)}"
            )
    if shape == "waypoints" and request.points is None:
        raise FaultyRequestError("/points", "points is missing: waypoints want two at least")
    values: dict[str, Any] = {"shape": shape}
    for name in (*members, *LIMITS):
        value = getattr(request, name)
        values[name] = getattr(rig.track, name) if value is None else value
    if shape == "step":
        values["levels_mN"] = list(values["levels_mN"])
    if request.x_pp_um is not None:
        values["force_pp_mN"] = rig.part.stiffness_mN_per_um * request.x_pp_um
    if request.points is not None:
        values["points"] = [point.model_dump() for point in request.points]
    return values


def requested_path(
    request: TrackJobRequest, values: dict[str, Any], K_e: float
) -> tuple[Path, str]:
    """The path, and the member of the request that its height comes from.

    Raises
    ------
    FaultyRequestError
        Where a member makes no path.
    """
    try:
        path, pointer = _path(values, K_e)
    except ValueError as error:
        pointer = "/points" if values["shape"] == "waypoints" else ""
        raise FaultyRequestError(pointer, str(error)) from error
    if path.duration_s > LONGEST_S:
        raise FaultyRequestError(
            "/points" if path.shape == "waypoints" else "/dwell_s" if path.knots else "/cycles",
            f"the path takes {path.duration_s:g} s, limit {LONGEST_S:g} s",
        )
    return path, "/x_pp_um" if request.x_pp_um is not None else pointer


def _path(values: Mapping[str, Any], K_e: float) -> tuple[Path, str]:
    shape: Shape = values["shape"]
    points = values.get("points") or ()
    named = {
        "mean": values.get("force_mean_mN"),
        "pp": values.get("force_pp_mN"),
        "levels": values.get("levels_mN"),
        "points": [(point["t_s"], point["force_mN"]) for point in points],
    }
    limits = K_e * values["rate_um_per_s"], K_e * values["acceleration_um_per_s2"]
    path = shaped_path("force", shape, {**values, **named}, limits)
    return path, POINTERS.get(shape, "/force_pp_mN")


def shaped_path(
    quantity: Literal["force", "position"],
    shape: Shape,
    values: Mapping[str, Any],
    limits: tuple[float, float],
) -> Path:
    """Return a path of a shape; raises ValueError for numbers that make none.

    Parameters
    ----------
    values
        ``mean``, ``pp``, ``frequency_hz`` and ``cycles``, or ``levels`` and ``dwell_s``, or
        ``points``.
    limits
        Highest rate and acceleration of the quantity.
    """
    if shape == "step":
        return steps(quantity, values["levels"], values["dwell_s"], *limits)
    if shape == "waypoints":
        return waypoints(quantity, values["points"])
    swing = values["mean"], values["pp"], values["frequency_hz"], values["cycles"]
    if shape == "triangle":
        return triangle(quantity, *swing, limits[1])
    return sinusoid(quantity, *swing)
