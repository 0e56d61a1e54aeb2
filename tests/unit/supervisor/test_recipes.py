"""Recipes: their allowed content, their versions, and how one completes a request."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from pydantic import TypeAdapter

from pincette.api.requests import JobRequest
from pincette.config import Calibration, RigFile, calibrated
from pincette_supervisor.journal import library as journal
from pincette_supervisor.journal.library import RecipeLimitError, RecipeRepository, RecipeRow
from pincette_supervisor.journal.store import Store
from pincette_supervisor.kinds.bodies import Body
from pincette_supervisor.planning.job_plans import (
    FaultyValuesError,
    ResolvedRequest,
    checked_values,
    plan,
    resolve,
)
from pincette_supervisor.planning.prediction import played, with_prediction
from pincette_supervisor.plugin import FaultyRequestError, Planned
from pincette_supervisor.plugin.model_in_use import rig_file_alone
from tests.support.rigs import demo_rig

from .harness import Harness

REQUEST: TypeAdapter[JobRequest] = TypeAdapter(Body)
AT = "2026-03-01T12:00:00.000Z"


def request(**wishes: Any) -> JobRequest:
    return REQUEST.validate_python({"kind": "grip", "recipe": "bead", **wishes})


def lookup(**values: Any) -> Callable[[str], RecipeRow | None]:
    """Return a collection with version 3 of one recipe."""
    row = RecipeRow("bead", 3, checked_values(values), "", AT)
    return lambda reference: row if reference in ("bead", "bead@3") else None


def resolved(values: dict[str, Any], rig: RigFile | None = None, **wishes: Any) -> ResolvedRequest:
    model = rig_file_alone(rig or demo_rig())
    return resolve(request(**wishes), model, None, lookup(**values))


def complete(values: dict[str, Any], **wishes: Any) -> dict[str, Any]:
    return resolved(values, **wishes).request.model_dump(exclude_unset=True)


def planned(rig: RigFile, values: dict[str, Any], **wishes: Any) -> Planned:
    return plan(resolved(values, rig, **wishes))


def keep(harness: Harness, status: int = 201, **body: Any) -> dict[str, Any]:
    response = harness.post("/recipes", {"name": "bead", **body})
    assert response.status_code == status, response.text
    return response.json()


def test_a_recipe_supplies_omitted_values_of_a_request() -> None:
    values = {"force_mN": 8.0, "hold_s": 2.0, "gains": {"K_P": 0.5}, "frequency_hz": 1.0}
    assert complete(values, hold_s=1.0) == {
        "kind": "grip",
        "recipe": "bead@3",
        "force_mN": 8.0,
        "hold_s": 1.0,
        "gains": {"K_P": 0.5},
    }
    assert complete(values, kind="track")["frequency_hz"] == 1.0


def test_a_request_overrides_fields_of_a_recipe_that_exclude_its_own() -> None:
    held = complete({"hold_s": 2.0, "force_mN": 8.0}, until_released=True)
    assert "hold_s" not in held
    assert held["force_mN"] == 8.0
    swing = complete({"shape": "sinusoid", "force_pp_mN": 9.0}, kind="track", x_pp_um=4.0)
    assert "force_pp_mN" not in swing
    steps = complete({"shape": "sinusoid", "cycles": 3, "load_s": 1.0}, kind="track", shape="step")
    assert steps == {"kind": "track", "recipe": "bead@3", "shape": "step", "load_s": 1.0}


def test_a_request_without_a_recipe_is_unchanged() -> None:
    found = resolved({"force_mN": 8.0}, recipe=None)
    assert found.kept == found.request == request(recipe=None)
    assert found.recipe is None


def test_the_journal_stores_the_version_of_the_recipe_and_not_its_values() -> None:
    kept = resolved({"force_mN": 8.0}).kept
    assert kept.model_dump(exclude_unset=True) == {"kind": "grip", "recipe": "bead@3"}


@pytest.mark.parametrize(
    ("wishes", "words"),
    [
        ({"recipe": "other"}, "no recipe 'other'"),
        ({"recipe": "bead@4"}, "no recipe 'bead@4'"),
        (
            {"kind": "move", "to_um": 3.0},
            "a recipe completes a grip or track, not a move",
        ),
    ],
)
def test_a_recipe_that_cannot_be_followed_is_named(wishes: dict[str, Any], words: str) -> None:
    with pytest.raises(FaultyRequestError, match=words) as raised:
        resolved({"force_mN": 8.0}, **wishes)
    assert raised.value.pointer == "/recipe"


def test_a_plan_states_its_recipe(rig_file: RigFile) -> None:
    found = planned(rig_file, {"force_mN": 8.0, "hold_s": 0.5})
    assert found.values["force_mN"] == 8.0
    stamp = found.values["recipe"]
    assert (stamp["name"], stamp["version"]) == ("bead", 3)
    assert len(stamp["digest"]) == 16
    assert "part" not in found.values


def test_a_recipe_states_position_and_stiffness_of_its_part(rig_file: RigFile) -> None:
    part = {"contact_um": 25.0, "stiffness_mN_per_um": 3.0}
    found = planned(rig_file, {"force_mN": 9.0, "hold_s": 0.5, "part": part})
    assert found.values["part"] == part
    assert found.program.contact_stiffness_mN_per_um == 3.0
    assert found.model.rig.part == rig_file.part
    played_one = played(found)
    assert played_one.outcome == "gripped"
    assert max(played_one.samples.x_um) == pytest.approx(28.0, abs=0.1)


def test_a_grip_of_an_object_farther_away_than_the_rig_files_part_is_predicted(
    rig_file: RigFile,
) -> None:
    """The estimator zeroes the force as late as the recipe's object allows."""
    found = planned(rig_file, {"part": {"contact_um": 40.0}})
    assert played(found).outcome == "gripped"
    predicted = with_prediction(found, played(found)).plan.prediction
    assert predicted is not None
    words = "part: contact_um = 40 µm (recipe bead@3), stiffness_mN_per_um = 2.17 mN/µm (assumed)"
    assert words in "; ".join(predicted.assumptions)


def test_the_rig_is_armed_with_the_part_of_the_recipe(rig_file: RigFile) -> None:
    part = {"contact_um": 40.0, "contact_tolerance_um": 1.0, "stiffness_tolerance": 0.1}
    noise = Calibration(values={"sensor.noise_um": 0.02}, sources={"sensor.noise_um": "job"})
    in_use = replace(rig_file_alone(rig_file), version=4, calibration=noise)
    found = plan(resolve(request(), in_use, None, lookup(part=part)))
    assert found.model is in_use
    assert found.values["model"] == in_use.stamp
    armed = found.armed.calibration
    assert armed.values == {
        "sensor.noise_um": 0.02,
        **{f"part.{name}": value for name, value in part.items()},
    }
    assert armed.sources == {
        "sensor.noise_um": "job",
        **{f"part.{name}": "recipe bead@3" for name in part},
    }
    assert calibrated(rig_file, armed).part.contact_tolerance_um == 1.0
    without = planned(rig_file, {"force_mN": 8.0})
    assert without.armed is without.model


@pytest.mark.parametrize(
    ("values", "place", "kind"),
    [
        ({"force_Mn": 8.0}, ("force_Mn",), "extra_forbidden"),
        ({"autostart": True}, ("autostart",), "extra_forbidden"),
        ({"kind": "grip"}, ("kind",), "extra_forbidden"),
        ({"force_mN": -1.0}, ("force_mN",), "greater_than"),
        ({"force_mN": "8"}, ("force_mN",), "float_type"),
        ({"gains": {"K_Q": 1.0}}, ("gains", "K_Q"), "extra_forbidden"),
        ({"part": {"contact": 1.0}}, ("part", "contact"), "extra_forbidden"),
        ({"part": {"stiffness_tolerance": 1.0}}, ("part", "stiffness_tolerance"), "less_than"),
        ({"points": [{"t_s": 0.0}]}, ("points", 0, "force_mN"), "missing"),
    ],
)
def test_an_impossible_value_is_reported_by_name(
    values: dict[str, Any], place: tuple[str | int, ...], kind: str
) -> None:
    with pytest.raises(FaultyValuesError) as raised:
        checked_values(values)
    first = raised.value.errors[0]
    assert (first["loc"], first["type"]) == (place, kind)


def test_faults_of_all_values_are_reported_at_once() -> None:
    with pytest.raises(FaultyValuesError) as raised:
        checked_values({"load_s": -1.0, "cycles": 0, "part": {"contact_um": "x"}, "odd": 1})
    assert sorted(error["loc"] for error in raised.value.errors) == [
        ("cycles",),
        ("load_s",),
        ("odd",),
        ("part", "contact_um"),
    ]


def test_versions_are_added_and_kept(harness: Harness) -> None:
    first = keep(harness, values={"force_mN": 8}, note="by hand")
    assert (first["version"], first["values"], first["note"]) == (1, {"force_mN": 8.0}, "by hand")
    assert keep(harness, 200, values={"force_mN": 8.0}, note="again") == first
    second = keep(harness, values={"force_mN": 9.0})
    assert second["version"] == 2
    assert second["digest"] != first["digest"]
    assert keep(harness, values={"force_mN": 8.0})["version"] == 3
    history = harness.get("/recipes/bead")
    assert [item["version"] for item in history["versions"]] == [3, 2, 1]
    assert history["newest"] == history["versions"][0]
    assert harness.get("/recipes/bead/1") == first
    keep(harness, name="Ball_2.5-mm", values={"until_released": True})
    assert [item["name"] for item in harness.get("/recipes")["recipes"]] == ["Ball_2.5-mm", "bead"]


def test_a_faulty_recipe_is_refused_with_the_location(harness: Harness) -> None:
    problem = keep(harness, 422, values={"force_mn": 8.0, "hold_s": -1.0})
    assert {error["pointer"] for error in problem["errors"]} == {
        "/values/force_mn",
        "/values/hold_s",
    }
    assert keep(harness, 422, name="a b", values={"hold_s": 1.0})["errors"][0]["pointer"] == "/name"
    assert keep(harness, 422, values={})["errors"][0]["pointer"] == "/values"
    assert harness.get("/recipes")["recipes"] == []


@pytest.mark.parametrize("path", ["none", "bead@1", "bead/2", "none/1"])
def test_an_unknown_recipe_is_not_found(harness: Harness, path: str) -> None:
    keep(harness, values={"force_mN": 8.0})
    assert harness.call("GET", f"/api/v1/recipes/{path}").status_code == 404


def test_a_job_uses_the_version_it_was_accepted_with(harness: Harness) -> None:
    keep(harness, values={"force_mN": 20.0, "hold_s": 4.0})
    keep(harness, values={"force_mN": 18.0})
    job = harness.grip(recipe="bead@1")
    assert job["values"]["recipe"]["version"] == 1
    assert harness.ended(job["id"])["state"] == "succeeded"
    newest = harness.post("/jobs", {"kind": "grip", "recipe": "bead"}).json()
    assert newest["request"]["recipe"] == "bead@2"
    assert newest["values"]["force_mN"] == 18.0


def test_the_part_of_a_recipe_is_used_for_its_own_job_only(harness: Harness) -> None:
    keep(harness, values={"part": {"contact_um": 29.0}})
    model = harness.manager.context.model.in_use
    job = harness.grip(recipe="bead")
    assert harness.freed(job["id"])["state"] == "succeeded"
    expected = Calibration(values={"part.contact_um": 29.0})
    assert harness.bus.calibration == expected.digest
    assert harness.get("/rigs/demo")["reasons"] == []
    assert harness.get(f"/jobs/{job['id']}")["values"]["model"] == model.stamp
    assert harness.freed(harness.grip()["id"])["state"] == "succeeded"
    assert harness.bus.calibration == ""


def test_a_job_with_an_unknown_recipe_is_refused(harness: Harness) -> None:
    refused = harness.post("/jobs", {"kind": "grip", "recipe": "none"})
    assert refused.status_code == 422
    assert refused.json()["errors"][0]["pointer"] == "/recipe"


def test_the_number_of_recipes_is_limited(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journal, "RECIPES_MAX", 2)
    monkeypatch.setattr(journal, "VERSIONS_MAX", 2)
    book = RecipeRepository(store)
    for name, force_mN in (("a", 1.0), ("a", 2.0), ("b", 1.0)):
        book.add(name, {"force_mN": force_mN}, "")
    with pytest.raises(RecipeLimitError, match="'a' has 2 versions"):
        book.add("a", {"force_mN": 3.0}, "")
    with pytest.raises(RecipeLimitError, match="there are 2 recipes"):
        book.add("c", {"force_mN": 1.0}, "")
    assert book.add("a", {"force_mN": 2.0}, "")[1] is False
    newest = book.find("a")
    assert newest is not None
    assert newest.reference == "a@2"
