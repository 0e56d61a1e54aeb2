"""Extreme numbers in every member of every request: refused by name, used, or reported in a
warning."""

from collections.abc import Iterator, Mapping
from math import inf, isclose, nan
from types import UnionType
from typing import Any, Union, cast, get_args, get_origin

import pytest
from pydantic import BaseModel, ValidationError

from pincette.cli import opened
from pincette.config import RigFile
from pincette_supervisor.kinds.bodies import REQUEST
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Planned, Present
from tests.support.checkout import ROOT

DEMO = opened(ROOT / "deploy" / "rigs" / "demo.toml")
RIG = DEMO.model_copy(update={"output": DEMO.output.model_copy(update={"step_V": 0.00122})})
TWO_ARMS = opened(ROOT / "deploy" / "rigs" / "two-arms.toml")
FORCE, PLACE = {"mean_mN": 15.0, "pp_mN": 10.0}, {"pp_um": 5.0}
POINTS = [{"t_s": 0.0, "force_mN": 5.0}, {"t_s": 2.0, "force_mN": 10.0}]
POSITIONS = [{"t_s": 0.0, "x_um": 33.0}, {"t_s": 2.0, "x_um": 35.0}]
BASES = (
    {"kind": "grip"},
    {"kind": "grip", "profile": "gentle"},
    {"kind": "track"},
    {"kind": "track", "shape": "triangle"},
    {"kind": "track", "shape": "step", "levels_mN": [5.0, 10.0]},
    {"kind": "track", "shape": "waypoints", "points": POINTS},
    {"kind": "track", "shape": "waypoints", "x_points": POSITIONS},
    {"kind": "move", "to_um": 5.0, "conditioning_cycles": 1},
    {"kind": "move", "by_um": 5.0},
    {"kind": "move", "to_V": 0.5},
    {"kind": "move", "by_V": 0.5},
    {"kind": "hold"},
    {"kind": "release"},
    {"kind": "calibrate", "calibration": "noise"},
    {"kind": "calibrate", "calibration": "free_response"},
    {"kind": "calibrate", "calibration": "compliance", "weights_mN": [0.0, 5.0, 10.0]},
    {"kind": "grip", "place_um": 1.0},
    {"kind": "grip", "centre": True, "place_um": 1.0},
    {"kind": "carry", "by_um": 1.0},
    {"kind": "track", "force": FORCE},
    {"kind": "track", "place": PLACE},
)
IMPOSSIBLE = (nan, inf, -inf)
EXTREME = (-1.0, 0.0, 1e-9, 1e-2, 1e6, 1e300)
TARGETS = ("to_um", "by_um", "to_V", "by_V")
BOUNDS = {
    "load_um_per_s": "highest speed",
    "rate_um_per_s": "highest speed",
    "acceleration_um_per_s2": "highest acceleration",
    "least_V": "lowest voltage",
    "most_V": "highest voltage",
    "tries": "number of tries, counted by the supervisor",
    "priority": "place in the queue",
    "approval_s": "time in which a person approves",
}
"""Members that bound what a plan does, or that no plan has."""
Path = tuple[str | int, ...]


def numbers(model: type[BaseModel], base: Mapping[str, Any]) -> Iterator[Path]:
    """Return paths of the numeric members of a request, including those of its nested objects."""
    for name, field in model.model_fields.items():
        kinds = parts(field.annotation)
        if float in kinds or int in kinds:
            yield (name,)
        nested = next((each for each in kinds if issubclass(each, BaseModel)), None)
        if nested is not None and name in base:
            listed = isinstance(base[name], list)
            inner = base[name][0] if listed else base[name]
            for path in numbers(nested, inner):
                yield (name, 1, *path) if listed else (name, *path)
        elif isinstance(base.get(name), list):
            yield (name, 1)


def parts(annotation: Any) -> set[type]:
    """Return the types of which an annotation consists."""
    if isinstance(annotation, type):
        return {annotation}
    if get_origin(annotation) in (Union, UnionType, list) or get_args(annotation):
        return {kind for each in get_args(annotation) for kind in parts(each)}
    return set()


def with_value(base: Mapping[str, Any], path: Path, value: float) -> dict[str, Any]:
    """Return the request with another value at a path."""
    requested: Any = {**base}
    if base["kind"] == "move" and path[0] in TARGETS:
        requested = {name: each for name, each in requested.items() if name not in TARGETS}
    if path[0] == "settling_s":
        requested["position_tolerance_um"] = 0.2
    place: Any = requested
    for key in path[:-1]:
        inner = place[key]
        place[key] = list(cast("list[Any]", inner)) if isinstance(inner, list) else {**inner}
        place = place[key]
    place[path[-1]] = value
    return requested


def found_in(values: Any, path: Path) -> Any:
    """Return the value of a plan under the name of a member; None if it has none."""
    for key in path:
        if isinstance(values, dict):
            values = cast("dict[Any, Any]", values).get(key)
        elif isinstance(values, list):
            values = cast("list[Any]", values)[cast("int", key)]
        else:
            return None
        if isinstance(values, BaseModel):
            values = values.model_dump()
    return values


def honoured(planned: Planned, path: Path, value: float) -> bool:
    """Return whether a plan uses a value, or states of the member that it does not."""
    plan, values, part = planned.plan, planned.values, RIG.part
    if path[0] == "x_points":
        path = ("points", *path[1:-1], str(path[-1]).replace("x_um", "force_mN"))
        if path[-1] == "force_mN":
            value = part.stiffness_mN_per_um * (value - part.contact_um)
    if not plan.feasible or path[-1] in BOUNDS:
        return True
    if any(str(path[0]) in text for text in getattr(plan, "warnings", ())):
        return True
    cycles = values.get("cycles")
    cycles = cast("dict[str, Any]", cycles) if isinstance(cycles, dict) else {}
    places = {
        "retries": planned.program.slip_retries,
        "conditioning_cycles": cycles.get("count"),
        "by_um": values.get("by_um", values.get("to_um")),
        "x_pp_um": found_in(values, ("force_pp_mN",)),
        **{name: cycles.get(name) for name in ("low_V", "high_V", "rate_V_per_s", "warm_up_s")},
    }
    kept = found_in(values, path)
    kept = places.get(str(path[-1])) if kept is None else kept
    if path[-1] == "x_pp_um":
        value = value * part.stiffness_mN_per_um
    if not value and path[-1] in ("conditioning_cycles", "warm_up_s"):
        kept = kept or 0.0
    return kept is not None and isclose(float(kept), value, rel_tol=1e-9)


def rig_of(base: Mapping[str, Any]) -> RigFile:
    """The rig that a kind is for."""
    return (
        TWO_ARMS if base.keys() & {"place_um", "place", "force"} or base["kind"] == "carry" else RIG
    )


@pytest.mark.parametrize("base", BASES, ids=lambda base: "-".join(map(str, base.values()))[:40])
def test_an_extreme_value_is_refused_or_applied_or_reported(base: dict[str, Any]) -> None:
    rig, wrong = rig_of(base), list[str]()
    paths = list(numbers(type(REQUEST.validate_python(base)), base))
    assert paths
    for path in paths:
        for value in IMPOSSIBLE:
            with pytest.raises(ValidationError):
                REQUEST.validate_python(with_value(base, path, value))
        for value in EXTREME:
            requested = with_value(base, path, value)
            try:
                planned = plan_job(REQUEST.validate_python(requested), rig, Present(0.0, 0.0))
            except ValueError as refusal:
                if not str(refusal):
                    wrong.append(f"{path} = {value:g}: refused without a reason")
                continue
            if not honoured(planned, path, value):
                wrong.append(f"{path} = {value:g}: {found_in(planned.values, path)}")
    assert wrong == []
