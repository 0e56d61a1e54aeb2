"""The path of a track request, or the paths of two arms, from its members."""

from collections.abc import Mapping
from typing import Any, Literal

from pincette.config import RigFile
from pincette.control.planning.path_shapes import sinusoid, steps, triangle, waypoints
from pincette.control.planning.paths import Path, Shape
from pincette_supervisor.kinds.track import MEMBERS, SWING, ForcePath, PlacePath, TrackJobRequest
from pincette_supervisor.plugin import FaultyRequestError

LIMITS = ("rate_um_per_s", "acceleration_um_per_s2")
LONGEST_S = 3600.0


def requested_path(request: TrackJobRequest, rig: RigFile) -> tuple[Path, dict[str, Any], str]:
    """Return the path of one arm, its values completed by the rig file, and what gives its height.

    Raises
    ------
    FaultyRequestError
        Where a member makes no path.
    """
    shape = request.shape or rig.track.shape
    members = MEMBERS[shape]
    for name in sorted({*SWING, "x_pp_um", *MEMBERS["step"], *MEMBERS["waypoints"]}):
        belongs = name in members or (name == "x_pp_um" and members is SWING)
        if getattr(request, name) is not None and not belongs:
            raise FaultyRequestError(f"/{name}", _stray(name, shape, members))
    if shape == "waypoints" and request.points is None:
        raise FaultyRequestError("/points", "points is missing: waypoints need at least two")
    values: dict[str, Any] = {"shape": shape}
    for name in (*members, *LIMITS):
        value = getattr(request, name)
        values[name] = getattr(rig.track, name) if value is None else value
    if shape == "step":
        values["levels_mN"] = list(values["levels_mN"])
    K_e = rig.part.stiffness_mN_per_um
    if request.x_pp_um is not None:
        values["force_pp_mN"] = K_e * request.x_pp_um
    if request.points is not None:
        values["points"] = [point.model_dump() for point in request.points]
    named = {_bare(name): values[name] for name in members}
    if shape == "waypoints":
        named["points"] = [tuple(point.values()) for point in values["points"]]
    path = _path(
        "force",
        shape,
        named,
        (K_e * values["rate_um_per_s"], K_e * values["acceleration_um_per_s2"]),
        "/points" if shape == "waypoints" else "",
        {"waypoints": "/points", "step": "/dwell_s"}.get(shape, "/cycles"),
    )
    pointer = {"step": "/levels_mN", "waypoints": "/points"}.get(shape, "/force_pp_mN")
    return path, values, "/x_pp_um" if request.x_pp_um is not None else pointer


def path_of_two(path: ForcePath | PlacePath, rig: RigFile, place_um: float) -> Path:
    """Return the path of the force or of the place of a part between two arms.

    Parameters
    ----------
    place_um
        Place where the part is expected: the usual mean of a path of the place.

    Raises
    ------
    FaultyRequestError
        Where a member makes no path.
    """
    track, shape = rig.track, path.shape
    members = tuple(_bare(name) for name in MEMBERS[shape])
    usual = {
        _bare(name): getattr(track, name)
        for names in MEMBERS.values()
        for name in names
        if name != "points"
    }
    quantity: Literal["force", "position"] = "force"
    pointer, squeeze = "/force", 1.0
    if isinstance(path, ForcePath):
        squeeze = sum(arm.model.compliance_um_per_mN for arm in rig.arms)
        squeeze += 1.0 / rig.part.stiffness_mN_per_um
    else:
        quantity, pointer = "position", "/place"
        usual |= {"mean": place_um, "pp": None, "levels": None}
    values: dict[str, Any] = {}
    for field in type(path).model_fields:
        name, value = _bare(field), getattr(path, field)
        if name in members:
            values[name] = usual.get(name) if value is None else value
        elif value is not None and field != "shape":
            raise FaultyRequestError(pointer, _stray(name, shape, members))
    missing = [name for name, value in values.items() if value is None]
    if missing:
        raise FaultyRequestError(pointer, f"a {shape} of {quantity} needs {', '.join(missing)}")
    if shape == "waypoints":
        values["points"] = [tuple(point.model_dump().values()) for point in values["points"]]
    limits = track.rate_um_per_s / squeeze, track.acceleration_um_per_s2 / squeeze
    return _path(quantity, shape, values, limits, pointer, pointer)


def _bare(name: str) -> str:
    """Return the name of a member without its quantity and its unit."""
    return name.removeprefix("force_").removesuffix("_mN").removesuffix("_um")


def _stray(name: str, shape: Shape, members: tuple[str, ...]) -> str:
    return f"{name} does not go with a {shape}, which takes {', '.join(members)}"


def _path(
    quantity: Literal["force", "position"],
    shape: Shape,
    values: Mapping[str, Any],
    limits: tuple[float, float],
    pointer: str,
    long_pointer: str,
) -> Path:
    """Return a path of a shape.

    Parameters
    ----------
    values
        ``mean``, ``pp``, ``frequency_hz`` and ``cycles``, or ``levels`` and ``dwell_s``, or
        ``points``.
    limits
        Highest rate and acceleration of the quantity.
    pointer, long_pointer
        Members of the request to blame for numbers that make no path, and for one that is too long.

    Raises
    ------
    FaultyRequestError
        Where the values make no path.
    """
    try:
        if shape == "step":
            path = steps(quantity, values["levels"], values["dwell_s"], *limits)
        elif shape == "waypoints":
            path = waypoints(quantity, values["points"])
        else:
            swing = values["mean"], values["pp"], values["frequency_hz"], values["cycles"]
            path = (
                triangle(quantity, *swing, limits[1])
                if shape == "triangle"
                else sinusoid(quantity, *swing)
            )
    except ValueError as error:
        raise FaultyRequestError(pointer, str(error)) from error
    if path.duration_s > LONGEST_S:
        raise FaultyRequestError(
            long_pointer, f"the path takes {path.duration_s:g} s, limit {LONGEST_S:g} s"
        )
    return path
