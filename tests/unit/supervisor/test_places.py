"""Positions of parts from external programs: valid and refused ones, and their use in plans and
results."""

from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from pydantic import ValidationError

from pincette.api.places import MeasuredPlace, PartPlace, PlaceFound, PlannedPlace
from pincette.bus.delivery import RateLimit
from pincette.config import RigFile
from pincette.core.messages import Place
from pincette.core.topics import PLACE
from pincette_supervisor.jobs import planner
from pincette_supervisor.journal.store import Store
from pincette_supervisor.journal.write_queue import WriteQueue
from pincette_supervisor.planning.job_plans import expecting_at, plan, plan_job, resolve
from pincette_supervisor.plugin import FaultyRequestError, Planned
from pincette_supervisor.plugin.model_in_use import rig_file_alone
from pincette_supervisor.rigs.places import Places
from tests.support.calibrating import REQUEST
from tests.support.two_arms import two_arm_rig

from .canned import CannedRig
from .harness import Harness

KEY = "pincette/v2/demo/place"


def ago(seconds: float = 0.0) -> str:
    """Return the time this many seconds ago."""
    return (datetime.now(UTC) - timedelta(seconds=seconds)).isoformat()


def stated(**changes: Any) -> dict[str, Any]:
    """Return a position of the demo rig's part, measured just now."""
    usual = {"x_um": 31.0, "u_um": 0.5, "measured_at": ago(), "source": "camera-1"}
    return {**usual, **changes}


def sent(**changes: Any) -> Place:
    """Return the same as a message on the bus."""
    fields: dict[str, Any] = {"rig": "demo", "width_um": None, "u_width_um": None}
    return Place(**{**fields, **stated(**changes)})


def planned_at(rig: RigFile, **place: Any) -> Planned:
    request = REQUEST.validate_python({"kind": "grip"})
    measured = MeasuredPlace(**stated(**place))
    given = PlannedPlace(**measured.model_dump(), age_s=0.1, max_age_s=5.0)
    found = resolve(request, rig_file_alone(rig), None, lambda _name: None)
    return plan(expecting_at(found, given))


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ({"x_um": 31.0}, "a place needs u_um, measured_at, source"),
        (stated(measured_at="2026-03-01T12:00:00"), "no time with its zone"),
        (stated(measured_at="now"), "no time with its zone"),
        (stated(u_um=0.0), "greater than 0"),
        (stated(x_um=float("nan")), "finite"),
        (stated(x_um=1e12), "less than or equal"),
        (stated(width_um=800.0), "give both or none"),
        (stated(given_by="bus"), "x_um, u_um, measured_at from the bus"),
        (stated(max_age_s=0.0), "greater than 0"),
        (stated(place="here"), "Extra inputs"),
    ],
)
def test_an_invalid_place_is_refused(place: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        PartPlace(**place)


def test_a_measured_place_sets_the_search_range_for_the_part(rig_file: RigFile) -> None:
    usual = plan_job(REQUEST.validate_python({"kind": "grip"}), rig_file)
    found = planned_at(rig_file, x_um=32.0, u_um=0.5)
    place = found.plan.place
    assert usual.plan.place is None
    assert place is not None
    (from_um,), (to_um,) = place.search_from_um, place.search_to_um
    assert from_um == pytest.approx(32.0 - 0.5 - 1.0)
    assert 33.5 < to_um < 38.0
    assert found.program.guards.contacts_from_um == (31.5,)
    assert found.armed.rig.part.contact_um == 32.0
    assert found.armed.calibration.sources["part.contact_um"] == "place of camera-1"
    assert found.model.rig.part.contact_um == rig_file.part.contact_um
    assert found.plan.feasible
    wide = planned_at(rig_file, x_um=32.0, u_um=4.0).plan.place
    assert wide is not None
    assert wide.search_to_um[0] - wide.search_from_um[0] == pytest.approx(
        to_um - from_um + 7.0, abs=1e-9
    )


def test_the_refusal_of_a_place_out_of_reach_points_to_its_field(rig_file: RigFile) -> None:
    for x_um in (0.5, 500.0):
        violations = planned_at(rig_file, x_um=x_um).plan.violations
        assert "/place/x_um" in [one.pointer for one in violations]


def test_two_arms_expect_the_part_at_its_place_with_its_width() -> None:
    rig = two_arm_rig({"second": {"gap_um": 60.0}})
    assert rig.second is not None
    closed_um = rig.part.contact_um + rig.second.contact_um
    found = planned_at(rig, x_um=0.4, u_um=0.3).armed.rig
    assert found.second is not None
    assert found.part.contact_um == pytest.approx(0.5 * closed_um + 0.4)
    assert found.second.contact_um == pytest.approx(0.5 * closed_um - 0.4)
    assert found.part.contact_tolerance_um > rig.part.contact_tolerance_um
    width_um = 60.0 - closed_um + 0.6
    found = planned_at(rig, x_um=0.4, u_um=0.3, width_um=width_um, u_width_um=0.8).armed.rig
    assert found.second is not None
    assert found.part.contact_um + found.second.contact_um == pytest.approx(closed_um - 0.6)
    assert found.part.contact_tolerance_um == pytest.approx(0.5)
    with pytest.raises(FaultyRequestError, match=r"needs second\.gap_um"):
        planned_at(two_arm_rig(), width_um=width_um, u_width_um=0.8)


def test_a_rig_of_one_arm_refuses_the_width_of_a_part(rig_file: RigFile) -> None:
    with pytest.raises(FaultyRequestError, match="width_um = 900 µm is for 2 driven arms"):
        planned_at(rig_file, width_um=900.0, u_width_um=2.0)


def refused(harness: Harness, **place: Any) -> dict[str, Any]:
    response = harness.post("/jobs", {"kind": "grip", "place": place})
    assert response.status_code == 409, response.text
    return response.json()


def test_an_old_or_unknown_place_is_refused_with_value_limit_and_remedy(harness: Harness) -> None:
    old = refused(harness, **stated(measured_at=ago(30.0), max_age_s=20.0))
    assert old["type"].endswith(":place-too-old")
    assert old["value"] == pytest.approx(30.0, abs=5.0)
    assert (old["limit"], old["unit"]) == (20.0, "s")
    assert "max_age_s = 20 s" in old["detail"]
    assert "measure the place again" in old["remedy"]
    ahead = refused(harness, **stated(measured_at=ago(-60.0)))
    assert "in the future" in ahead["detail"]
    unknown = refused(harness, given_by="bus")
    assert unknown["type"].endswith(":place-unknown")
    assert KEY in unknown["detail"]
    assert unknown["sources"] == []


def test_a_job_uses_the_newest_place_from_the_bus(harness: Harness) -> None:
    for x_um in (30.5, 31.0):
        harness.bus.publish(sent(x_um=x_um))
    harness.bus.publish(sent(x_um=29.0, measured_at=ago(3.0)))
    seen = harness.get("/rigs/demo/places")
    assert [one["x_um"] for one in seen["newest"]] == [31.0]
    assert seen["key"] == KEY
    values = {"given_by": "bus", "max_age_s": 600}
    plan = harness.post("/jobs", {"kind": "grip", "place": values, "dry_run": True}).json()
    assert plan["place"]["x_um"] == 31.0
    job = harness.ended(harness.grip(place=values)["id"])
    assert job["request"]["place"] == values
    assert job["values"]["place"]["source"] == "camera-1"
    reported = job["result"]["place"]
    assert reported["given_um"] == 31.0
    assert reported["difference_um"] == pytest.approx(job["result"]["contact_x_um"] - 31.0)
    assert reported["uncertainty_um"] >= 0.5
    assert reported["bias"]["count"] == 1
    harness.bus.publish(sent(source="camera-2"))
    assert refused(harness, given_by="bus")["sources"] == ["camera-1", "camera-2"]


def test_a_job_fails_if_its_place_is_too_old_when_it_starts_to_move(harness: Harness) -> None:
    place = stated(measured_at=ago(4.8), max_age_s=5.0)
    response = harness.post("/jobs", {"kind": "grip", "place": place})
    if response.status_code == 409:
        return  # the machine took longer than the place is young
    job = response.json()["id"]
    harness.reach(job, "ready")
    harness.until(lambda: MeasuredPlace(**place_of(place)).seconds_until(datetime.now(UTC)) > 5.0)
    harness.acted(job, "start")
    ended = harness.ended(job)
    assert ended["state"] == "failed"
    assert ended["ending"]["problem"] == "place-too-old"


def place_of(place: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in place.items() if name in MeasuredPlace.model_fields}


@pytest.fixture
def places(store: Store, rig_file: RigFile) -> Places:
    return Places("demo", store, WriteQueue(), CannedRig(rig_file).refused)


@pytest.mark.parametrize(
    ("message", "words"),
    [
        ({"rig": "other"}, "rig = 'other': this is the key of 'demo'"),
        ({"u_um": -0.5}, "u_um"),
        ({"source": ""}, "source"),
        ({"source": "c" * 200}, "source"),
        ({"measured_at": "yesterday"}, "no time with its zone"),
        ({"measured_at": "2100-01-01T00:00:00Z"}, "in the future"),
        ({"width_um": 5.0}, "give both or none"),
    ],
)
def test_an_invalid_place_message_is_refused_and_its_reason_is_shown(
    places: Places, message: dict[str, Any], words: str
) -> None:
    places.take(PLACE, sent(**message))
    assert places.view().newest == []
    assert words in places.refused
    with pytest.raises(planner.ProblemError, match="the last message was refused"):
        places.given(PartPlace(given_by="bus"))


def test_the_number_of_stored_sources_of_places_is_limited(places: Places) -> None:
    for number in range(100):
        places.take(PLACE, sent(source=f"camera-{number}"))
    assert len(places.view().newest) == 16
    limit = RateLimit(50.0, clock := iter([0.0] * 201 + [1.0]).__next__)
    assert sum(limit.allows() for _ in range(200)) == 50
    assert limit.allows()
    assert clock


def test_the_bias_of_a_source_is_stored_and_counts_each_job_once(
    places: Places, store: Store, rig_file: RigFile
) -> None:
    def found(difference_um: float) -> PlaceFound:
        return PlaceFound(
            source="camera-1", age_s=0.1, given_um=31.0, found_um=31.0 + difference_um,
            difference_um=difference_um, uncertainty_um=0.5,
        )  # fmt: skip

    for job, difference_um in (("a", 0.2), ("b", 0.4), ("b", 0.4)):
        bias = places.with_bias(job, found(difference_um)).bias
    assert bias is not None
    assert (bias.count, bias.mean_um) == (2, pytest.approx(0.3))
    assert bias.deviation_um == pytest.approx(0.1414, abs=1e-3)
    nothing = found(0.0).model_copy(update={"difference_um": None})
    assert places.with_bias("c", nothing).bias is None
    again = Places("demo", store, WriteQueue(), CannedRig(rig_file).refused)
    assert again.view().biases == [bias]
    for job in range(150):
        bias = again.with_bias(str(job), found(1.0)).bias
    assert bias is not None
    assert (bias.count, bias.mean_um) == (100, 1.0)


def test_a_trajectory_cannot_contain_a_place(harness: Harness) -> None:
    response = harness.post("/trajectories", {"kind": "grip", "place": stated()})
    assert response.status_code == 422
    assert response.json()["errors"][0]["pointer"] == "/place"
