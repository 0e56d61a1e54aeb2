"""The law that a job chooses: completed by the rig file, judged, told, kept."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pincette.api.request_models import GripJobRequest, TrackJobRequest
from pincette.config import RigFile
from pincette.config.gains import judged, tuned
from pincette.control.laws.law import LawSettings, ParameterSet, Scheme, default_settings
from pincette_supervisor.planning import laws
from pincette_supervisor.planning.job_plans import plan_job

from .rig import Desk

GAINS = ("K_P", "K_I", "K_S", "delta", "M", "B", "K", "K_f", "force_age")
UNSTABLE = {"K_S": 1.0, "delta": 1.0}
"""A switching term whose slope makes the loop rattle."""


@pytest.fixture
def straight(rig_file: RigFile) -> RigFile:
    """A rig whose free response is known as a line alone; its gains are quickly found."""
    model = rig_file.model.model_copy(update={"free_response": None})
    return rig_file.model_copy(update={"model": model})


def dry_run(desk: Desk, **wishes: Any) -> dict[str, Any]:
    response = desk.post("/jobs", {"kind": "grip", **wishes}, dry_run="true")
    assert response.status_code == 200, response.text
    return response.json()


def refused(desk: Desk, wishes: dict[str, Any], problem: str) -> dict[str, Any]:
    """The problem with which a job is refused; nothing has moved and no job is kept."""
    response = desk.post("/jobs", {"kind": "grip", "autostart": True, **wishes})
    assert response.status_code == 422
    assert response.json()["type"] == f"urn:pincette:problem:{problem}"
    assert desk.get("/jobs")["jobs"] == []
    assert desk.bus.asked == []
    return response.json()


def settings_of(law: dict[str, Any]) -> LawSettings:
    return LawSettings(law["scheme"], law["set"], **{name: law[name] for name in GAINS})


def test_without_a_wish_it_is_that_of_the_rig_file(desk: Desk, rig_file: RigFile) -> None:
    law = dry_run(desk)["law"]
    assert settings_of(law) == rig_file.law.settings()
    assert law["gains_from"] == "rig"
    found = judged(rig_file, rig_file.law.settings())
    assert (law["spectral_radius"], law["spectral_radius_limit"]) == (
        found.radius,
        found.limit_radius,
    )
    # Named as it is in the rig file anyhow, it is still the rig file's.
    assert dry_run(desk, scheme="pbsmic", set="consistent")["law"] == law


@pytest.mark.parametrize(
    ("wishes", "scheme", "name", "origin"),
    [
        ({"scheme": "dsmifc"}, "dsmifc", "consistent", "default"),
        ({"set": "printed"}, "pbsmic", "printed", "paper"),
        ({"scheme": "dsmifc", "set": "printed"}, "dsmifc", "printed", "paper"),
    ],
)
def test_a_law_that_the_rig_file_has_not_is_that_of_the_paper_or_the_default(
    desk: Desk, wishes: dict[str, Any], scheme: Scheme, name: ParameterSet, origin: str
) -> None:
    law = dry_run(desk, **wishes)["law"]
    assert settings_of(law) == default_settings(scheme, name)
    assert law["gains_from"] == origin


def test_a_rig_file_without_a_law_of_its_own_says_what_it_has(
    rig_file: RigFile, open_desk: Callable[..., Desk]
) -> None:
    own = rig_file.law.model_copy(update={"scheme": "dsmifc", "delta": 1e6, "K_P": 1.5})
    desk = open_desk(rig_file.model_copy(update={"law": own}))
    law = dry_run(desk)["law"]
    assert (law["scheme"], law["K_P"], law["gains_from"]) == ("dsmifc", 1.5, "rig")
    other = dry_run(desk, scheme="pbsmic")["law"]
    assert (other["K_P"], other["gains_from"]) == (1.0, "default")


def test_gains_of_a_request_replace_those_it_names(desk: Desk, rig_file: RigFile) -> None:
    law = dry_run(desk, gains={"K_P": 0.5, "K_f": 4000.0})["law"]
    own = rig_file.law.settings()
    assert (law["K_P"], law["K_f"], law["gains_from"]) == (0.5, 4000.0, "request")
    assert [law[name] for name in GAINS if name not in ("K_P", "K_f")] == [
        getattr(own, name) for name in GAINS if name not in ("K_P", "K_f")
    ]
    over_paper = dry_run(desk, set="printed", gains={"K_P": 0.5, "force_age": "planned"})["law"]
    assert (over_paper["K_P"], over_paper["K_S"]) == (0.5, 0.003)
    assert over_paper["force_age"] == "planned"


@pytest.mark.parametrize("scheme", ["pbsmic", "dsmifc"])
def test_tuned_gains_are_those_of_the_search(
    straight: RigFile, open_desk: Callable[..., Desk], scheme: Scheme
) -> None:
    law = dry_run(open_desk(straight), scheme=scheme, gains="tuned")["law"]
    found = tuned(straight, scheme)
    assert settings_of(law) == found.chosen.settings
    assert law["gains_from"] == "tuned"
    assert law["spectral_radius"] == found.radius


@pytest.mark.parametrize(
    ("wishes", "pointer", "words"),
    [
        ({"gains": "tuned", "set": "printed"}, "/gains", "tuned for the consistent set"),
        ({"gains": "best"}, "/gains", "gains = 'best'"),
        ({"gains": {"K_Q": 1.0}}, "/gains/K_Q", "K_Q is not a field that is known here"),
        ({"gains": {"K_P": -1.0}}, "/gains/K_P", "K_P = -1.0"),
        ({"gains": {"K": 0.0}}, "/gains/K", "K = 0.0"),
        ({"gains": {"force_age": "old"}}, "/gains/force_age", "force_age = 'old'"),
        ({"scheme": "pid"}, "/scheme", "scheme = 'pid'"),
        ({"set": "other"}, "/set", "set = 'other'"),
    ],
)
def test_a_fault_of_a_law_is_named_with_its_place(
    desk: Desk, wishes: dict[str, Any], pointer: str, words: str
) -> None:
    (error,) = refused(desk, wishes, "invalid-request")["errors"]
    assert error["pointer"] == pointer
    assert words in error["message"]


def test_gains_whose_loop_cannot_be_reckoned_are_refused(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(*_: object) -> None:
        raise np.linalg.LinAlgError("Eigenvalues did not converge")

    monkeypatch.setattr(laws, "judged", none)
    (error,) = refused(desk, {"gains": {"K_P": 1.0}}, "invalid-request")["errors"]
    assert error["pointer"] == "/gains"
    assert "no spectral radius can be found for these gains: Eigenvalues" in error["message"]


def test_tuned_is_refused_where_the_rig_file_has_the_printed_set(
    rig_file: RigFile, open_desk: Callable[..., Desk]
) -> None:
    printed = rig_file.law.model_copy(update={"set": "printed"})
    desk = open_desk(rig_file.model_copy(update={"law": printed}))
    (error,) = refused(desk, {"gains": "tuned"}, "invalid-request")["errors"]
    assert error["pointer"] == "/gains"


def test_a_search_without_a_find_is_a_fault_of_the_gains(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(_rig: RigFile, _scheme: Scheme) -> None:
        raise ValueError("none of the gains tried: take a longer period")

    monkeypatch.setattr(laws, "tuned", none)
    (error,) = refused(desk, {"gains": "tuned"}, "invalid-request")["errors"]
    assert error == {
        "pointer": "/gains",
        "message": "none of the gains tried: take a longer period",
    }


@pytest.mark.parametrize("kind", ["grip", "track"])
def test_an_unstable_law_is_a_limit_and_nothing_moves(
    desk: Desk, rig_file: RigFile, kind: str
) -> None:
    problem = refused(desk, {"kind": kind, "gains": UNSTABLE}, "limit-violation")
    (violation,) = problem["violations"]
    law = LawSettings(K_S=1.0, delta=1.0)
    found = judged(rig_file, law)
    assert (violation["quantity"], violation["pointer"]) == ("spectral radius", "/gains")
    assert violation["value"] == found.radius > violation["limit"] == found.limit_radius
    assert violation["message"] == found.reason
    assert found.reason in problem["detail"]
    plan = dry_run(desk, kind=kind, gains=UNSTABLE)
    assert plan["feasible"] is False
    assert plan["violations"] == [violation]
    assert plan["law"]["spectral_radius"] == found.radius


def test_an_unstable_law_comes_after_what_else_the_plan_breaks(desk: Desk) -> None:
    plan = dry_run(desk, force_mN=55.0, gains=UNSTABLE)
    quantities = [violation["quantity"] for violation in plan["violations"]]
    assert "force" in quantities
    assert quantities[-1] == "spectral radius"


@pytest.mark.parametrize(
    "wishes",
    [
        {"scheme": "dsmifc", "gains": {"K_P": 0.5, "K_f": 4000.0}},
        {"set": "printed"},
    ],
)
def test_the_law_is_kept_with_the_job_and_its_record(desk: Desk, wishes: dict[str, Any]) -> None:
    planned = dry_run(desk, **wishes)["law"]
    taken = desk.grip(**wishes)
    assert taken["values"]["law"] == planned
    job = desk.ended(taken["id"])
    assert job["state"] == "succeeded"
    assert job["values"]["law"] == planned
    record = json.loads((Path(job["record"]) / "request.json").read_text(encoding="utf-8"))
    assert record["values"]["law"] == record["plan"]["law"] == planned
    assert record["request"] == {"kind": "grip", "autostart": True, **wishes}


def test_the_program_carries_the_law(rig_file: RigFile) -> None:
    law = default_settings("dsmifc", "printed")
    wishes = {"scheme": "dsmifc", "set": "printed"}
    for request in (
        GripJobRequest.model_validate({"kind": "grip", **wishes}),
        TrackJobRequest.model_validate({"kind": "track", **wishes}),
    ):
        assert plan_job(request, rig_file).program.laws == (law,)


def test_the_steady_errors_are_those_of_the_law(desk: Desk) -> None:
    softest, offset_um = 2.17 * 0.7, 3.0
    mismatch_mN = 20.0 - softest * (20.0 / 2.17 - offset_um)
    for gain in (1000.0, 10000.0):
        errors = dry_run(desk, force_mN=20.0, gains={"K_f": gain})["steady_errors"]
        traded = 1.9901e4 / gain
        worst_um = mismatch_mN / (softest + traded)
        assert errors["position_max_um"] == pytest.approx(worst_um)
        assert errors["force_min_mN"] == pytest.approx(-traded * worst_um)
    stiff = dry_run(desk, force_mN=20.0, gains={"K_f": 0.0})["steady_errors"]
    assert stiff["position_max_um"] == stiff["position_min_um"] == 0.0
    assert stiff["force_min_mN"] == pytest.approx(-mismatch_mN)
