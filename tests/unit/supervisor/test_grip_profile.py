"""Which profile a grip has: by request, rig file, model and force; and what is refused."""

import pytest

from pincette.config import RigFile
from pincette.control.planning.segments import Press, Seek
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import FaultyRequestError, Planned
from tests.support.rigs import Tree, demo_rig


def planned(rig: RigFile | None = None, /, **wishes: object) -> Planned:
    request = GripJobRequest.model_validate({"kind": "grip", **wishes})
    return plan_job(request, rig or demo_rig())


def refused(rig: RigFile | None = None, /, **wishes: object) -> FaultyRequestError:
    with pytest.raises(FaultyRequestError) as caught:
        planned(rig, **wishes)
    return caught.value


def untaught(changes: Tree | None = None) -> RigFile:
    rig = demo_rig(changes or {})
    return rig.model_copy(update={"model": rig.model.model_copy(update={"free_response": None})})


def test_a_grip_is_quick_by_default_and_states_its_speeds() -> None:
    made = planned()
    assert made.plan.feasible
    assert made.values["profile"] == "quick"
    assert made.values["seek_um_per_s"] == 40.0
    assert 80.0 < made.values["approach_um_per_s"] <= 120.0
    assert made.values["load_s"] < made.values["unload_s"] < 0.5
    assert made.plan.duration_s < 8.0


def test_the_plan_of_a_gentle_grip_is_unchanged() -> None:
    made = planned(profile="gentle")
    assert made.values["profile"] == "gentle"
    assert [segment.duration_s for segment in made.program.segments if segment.phase == "load"] == [
        2.0
    ]
    segments = made.program.segments
    assert not any(one.follows for one in segments if isinstance(one, Press))
    assert [one.run_up_s for one in segments if isinstance(one, Seek)] == [0.0]


def test_a_rig_file_may_be_gentle_and_a_request_quick() -> None:
    gentle = demo_rig({"grip": {"profile": "gentle"}})
    assert planned(gentle).values["profile"] == "gentle"
    assert planned(gentle, profile="quick").values["profile"] == "quick"


def test_without_an_identified_response_a_grip_is_gentle() -> None:
    assert planned(untaught()).values["profile"] == "gentle"
    error = refused(untaught(), profile="quick")
    assert error.pointer == "/profile"
    assert "calibrate free_response" in str(error)


def test_a_force_too_small_for_a_quick_search_is_gripped_gently() -> None:
    assert planned(force_mN=4.0).values["profile"] == "gentle"
    assert planned(force_mN=4.1).values["profile"] == "gentle"
    assert planned(force_mN=5.0).values["profile"] == "quick"
    error = refused(force_mN=4.0, profile="quick")
    assert error.pointer == "/force_mN"
    assert "not above 4 mN" in str(error)


@pytest.mark.parametrize(("name", "limit"), [("approach_um_per_s", 54.3), ("seek_um_per_s", 27.1)])
def test_a_speed_beyond_the_limit_makes_the_plan_infeasible(name: str, limit: float) -> None:
    plan = planned(force_mN=8.0, **{name: 60.0}).plan
    assert not plan.feasible
    violation = plan.violations[0]
    assert (violation.pointer, violation.value, violation.unit) == (f"/{name}", 60.0, "µm/s")
    assert violation.limit == pytest.approx(limit, abs=0.1)


def test_a_load_has_a_time_or_a_speed() -> None:
    with pytest.raises(ValueError, match="exclude each other"):
        planned(load_s=0.4, load_um_per_s=40.0)
    error = refused(profile="gentle", load_um_per_s=40.0)
    assert error.pointer == "/load_um_per_s"
    assert "give load_s instead" in str(error)


def test_slower_loads_take_longer() -> None:
    slow, usual = planned(load_um_per_s=15.0), planned()
    assert slow.plan.feasible
    assert slow.values["seek_um_per_s"] <= 15.0
    assert slow.values["load_s"] > 1.5 * usual.values["load_s"]
