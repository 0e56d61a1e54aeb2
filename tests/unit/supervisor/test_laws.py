"""The law that a job chooses: completed by the rig file, checked, stated, stored."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pincette.config import RigFile
from pincette.config.gains import judged, tuned
from pincette.control.laws.definition import LawSettings
from pincette.control.laws.parameters import ParameterSet
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.kinds.track import TrackJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import laws
from tests.support.laws import default_settings, law_settings

from .harness import Harness

GAINS = ("K_P", "K_I", "K_S", "delta", "M", "B", "K", "K_f", "force_age")
UNSTABLE = {"K_S": 1.0, "delta": 1.0}
"""A switching term whose slope makes the loop oscillate."""


@pytest.fixture
def straight(rig_file: RigFile) -> RigFile:
    """Return a rig whose free response is known as a line only; its gains are found quickly."""
    model = rig_file.model.model_copy(update={"free_response": None})
    return rig_file.model_copy(update={"model": model})


def dry_run(harness: Harness, **wishes: Any) -> dict[str, Any]:
    response = harness.post("/jobs", {"kind": "grip", **wishes}, dry_run="true")
    assert response.status_code == 200, response.text
    return response.json()


def refused(harness: Harness, wishes: dict[str, Any], problem: str) -> dict[str, Any]:
    """Return the problem with which a job is refused; nothing has moved and no job is stored."""
    response = harness.post("/jobs", {"kind": "grip", "autostart": True, **wishes})
    assert response.status_code == 422
    assert response.json()["type"] == f"urn:pincette:problem:{problem}"
    assert harness.get("/jobs")["jobs"] == []
    assert harness.bus.asked == []
    return response.json()


def settings_of(law: dict[str, Any]) -> LawSettings:
    return law_settings(law["scheme"], law["set"], law["force_age"], **law["gains"])


def test_the_default_law_is_that_of_the_rig_file(harness: Harness, rig_file: RigFile) -> None:
    law = dry_run(harness)["law"]
    assert settings_of(law) == rig_file.law_settings
    assert law["gains_from"] == "rig"
    found = judged(rig_file, rig_file.law_settings)
    assert (law["spectral_radius"], law["spectral_radius_limit"]) == (
        found.radius,
        found.limit_radius,
    )
    # Named as it is in the rig file anyhow, it is still the rig file's.
    assert dry_run(harness, scheme="pbsmic", set="identified")["law"] == law


@pytest.mark.parametrize(
    ("wishes", "scheme", "name", "origin"),
    [
        ({"scheme": "dsmifc"}, "dsmifc", "identified", "default"),
        ({"set": "consistent"}, "pbsmic", "consistent", "default"),
        ({"set": "printed"}, "pbsmic", "printed", "paper"),
        ({"scheme": "dsmifc", "set": "printed"}, "dsmifc", "printed", "paper"),
    ],
)
def test_gains_of_a_law_that_the_rig_file_lacks_are_those_of_the_paper_or_the_defaults(
    harness: Harness, wishes: dict[str, Any], scheme: str, name: ParameterSet, origin: str
) -> None:
    law = dry_run(harness, **wishes)["law"]
    assert settings_of(law) == default_settings(scheme, name)
    assert law["gains_from"] == origin


def test_a_rig_file_without_a_law_states_the_default(
    rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    own = rig_file.law.model_copy(update={"scheme": "dsmifc", "delta": 1e6, "K_P": 1.5})
    harness = open_harness(rig_file.model_copy(update={"law": own}))
    law = dry_run(harness)["law"]
    assert (law["scheme"], law["gains"]["K_P"], law["gains_from"]) == ("dsmifc", 1.5, "rig")
    other = dry_run(harness, scheme="pbsmic")["law"]
    assert (other["gains"]["K_P"], other["gains_from"]) == (1.0, "default")


def test_gains_of_a_request_replace_only_those_gains(harness: Harness, rig_file: RigFile) -> None:
    law = dry_run(harness, gains={"K_P": 0.5, "K_f": 4000.0})["law"]
    own = rig_file.law_settings
    assert law["gains_from"] == "request"
    assert law["gains"] == {**own.gains, "K_P": 0.5, "K_f": 4000.0}
    over_paper = dry_run(harness, set="printed", gains={"K_P": 0.5, "force_age": "planned"})["law"]
    assert (over_paper["gains"]["K_P"], over_paper["gains"]["K_S"]) == (0.5, 0.003)
    assert over_paper["force_age"] == "planned"


@pytest.mark.parametrize("scheme", ["pbsmic", "dsmifc"])
def test_tuned_gains_are_those_of_the_search(
    straight: RigFile, open_harness: Callable[..., Harness], scheme: str
) -> None:
    law = dry_run(open_harness(straight), scheme=scheme, gains="tuned")["law"]
    found = tuned(straight, scheme)
    assert settings_of(law) == found.chosen.settings
    assert law["gains_from"] == "tuned"
    assert law["spectral_radius"] == found.radius


@pytest.mark.parametrize(
    ("wishes", "pointer", "words"),
    [
        ({"gains": "tuned", "set": "printed"}, "/gains", "tuned for the sets"),
        ({"gains": "best"}, "/gains", "gains = 'best'"),
        ({"gains": {"K_Q": 1.0}}, "/gains/K_Q", "PBSMIC has no gain K_Q; its gains are K_P, K_I,"),
        ({"gains": {"K_P": -1.0}}, "/gains/K_P", "K_P = -1.0"),
        ({"gains": {"K": 0.0}}, "/gains/K", "K = 0.0"),
        ({"gains": {"force_age": "old"}}, "/gains/force_age", "force_age = 'old'"),
        ({"scheme": "pid"}, "/scheme", "scheme = 'pid'"),
        ({"set": "other"}, "/set", "set = 'other'"),
    ],
)
def test_a_fault_of_a_law_is_reported_with_its_location(
    harness: Harness, wishes: dict[str, Any], pointer: str, words: str
) -> None:
    (error,) = refused(harness, wishes, "invalid-request")["errors"]
    assert error["pointer"] == pointer
    assert words in error["message"]


def test_the_identified_set_needs_an_identified_response(
    straight: RigFile, open_harness: Callable[..., Harness]
) -> None:
    harness = open_harness(straight)
    assert dry_run(harness)["law"]["set"] == "consistent"
    (error,) = refused(harness, {"set": "identified"}, "invalid-request")["errors"]
    assert error["pointer"] == "/set"
    assert "calibrate free_response" in error["message"]


def test_gains_whose_loop_cannot_be_computed_are_refused(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(*_: object) -> None:
        raise np.linalg.LinAlgError("Eigenvalues did not converge")

    monkeypatch.setattr(laws, "judged", none)
    (error,) = refused(harness, {"gains": {"K_P": 1.0}}, "invalid-request")["errors"]
    assert error["pointer"] == "/gains"
    assert "the spectral radius for these gains cannot be computed: Eigenvalues" in error["message"]


def test_tuned_gains_are_refused_if_the_rig_file_has_the_printed_set(
    rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    printed = rig_file.law.model_copy(update={"set": "printed"})
    harness = open_harness(rig_file.model_copy(update={"law": printed}))
    (error,) = refused(harness, {"gains": "tuned"}, "invalid-request")["errors"]
    assert error["pointer"] == "/gains"


def test_a_search_without_a_contact_is_reported_as_a_fault_of_the_gains(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(_rig: RigFile, _scheme: str, _set: ParameterSet) -> None:
        raise ValueError("none of the gains tried: choose a longer period")

    monkeypatch.setattr(laws, "tuned", none)
    (error,) = refused(harness, {"gains": "tuned"}, "invalid-request")["errors"]
    assert error == {
        "pointer": "/gains",
        "message": "none of the gains tried: choose a longer period",
    }


@pytest.mark.parametrize("kind", ["grip", "track"])
def test_an_unstable_law_is_a_limit_and_nothing_moves(
    harness: Harness, rig_file: RigFile, kind: str
) -> None:
    problem = refused(harness, {"kind": kind, "gains": UNSTABLE}, "limit-violation")
    (violation,) = problem["violations"]
    law = default_settings("pbsmic", "identified").with_gains(**UNSTABLE)
    found = judged(rig_file, law)
    assert (violation["quantity"], violation["pointer"]) == ("spectral_radius", "/gains")
    assert violation["value"] == found.radius > violation["limit"] == found.limit_radius
    assert violation["message"] == found.reason
    assert found.reason in problem["detail"]
    plan = dry_run(harness, kind=kind, gains=UNSTABLE)
    assert plan["feasible"] is False
    assert plan["violations"] == [violation]
    assert plan["law"]["spectral_radius"] == found.radius


def test_an_unstable_law_is_reported_after_other_broken_limits(harness: Harness) -> None:
    plan = dry_run(harness, force_mN=55.0, gains=UNSTABLE)
    quantities = [violation["quantity"] for violation in plan["violations"]]
    assert "force" in quantities
    assert quantities[-1] == "spectral_radius"


@pytest.mark.parametrize(
    "wishes",
    [
        {"scheme": "dsmifc", "gains": {"K_P": 0.5, "K_f": 4000.0}},
        {"set": "printed"},
    ],
)
def test_the_law_is_stored_with_the_job_and_its_record(
    harness: Harness, wishes: dict[str, Any]
) -> None:
    planned = dry_run(harness, **wishes)["law"]
    taken = harness.grip(**wishes)
    assert taken["values"]["law"] == planned
    job = harness.ended(taken["id"])
    assert job["state"] == "succeeded"
    assert job["values"]["law"] == planned
    record = json.loads((Path(job["record"]) / "request.json").read_text(encoding="utf-8"))
    assert record["values"]["law"] == record["plan"]["law"] == planned
    assert record["request"] == {"kind": "grip", "autostart": True, **wishes}


def test_the_planned_program_contains_the_law(rig_file: RigFile) -> None:
    law = default_settings("dsmifc", "printed")
    wishes = {"scheme": "dsmifc", "set": "printed"}
    for request in (
        GripJobRequest.model_validate({"kind": "grip", **wishes}),
        TrackJobRequest.model_validate({"kind": "track", **wishes}),
    ):
        assert plan_job(request, rig_file).program.laws == (law.spec(),)


def test_the_stated_steady_errors_are_those_of_the_law(harness: Harness) -> None:
    softest, offset_um = 2.17 * 0.7, 3.0
    mismatch_mN = 20.0 - softest * (20.0 / 2.17 - offset_um)
    for gain in (1000.0, 10000.0):
        errors = dry_run(harness, force_mN=20.0, gains={"K_f": gain})["steady_errors"]
        traded = 1.9901e4 / gain
        worst_um = mismatch_mN / (softest + traded)
        assert errors["position_max_um"] == pytest.approx(worst_um)
        assert errors["force_min_mN"] == pytest.approx(-traded * worst_um)
    stiff = dry_run(harness, force_mN=20.0, gains={"K_f": 0.0})["steady_errors"]
    assert stiff["position_max_um"] == stiff["position_min_um"] == 0.0
    assert stiff["force_min_mN"] == pytest.approx(-mismatch_mN)
