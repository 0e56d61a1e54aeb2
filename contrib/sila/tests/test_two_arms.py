"""A rig of two driven arms with the stock client: both arms close and report their force."""

from collections.abc import Generator
from typing import Any

import pytest

from contrib.support.sila import refusal, responses, stock_client
from pincette.config.reading import laid_over
from tests.support.adapters import FORCE_MN, NEAR_MN, ports_of_adapters, until
from tests.support.rigs import at_own_ports
from tests.support.running import RunningRig, running_rig
from tests.support.two_arms import SHORT_PAIR, two_arm_rig


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    own = at_own_ports(two_arm_rig(laid_over(SHORT_PAIR, ports_of_adapters())))
    with running_rig(own, tmp_path_factory.mktemp("sila")) as running:
        running.fleet.start(["sila"])
        yield running


@pytest.fixture
def client(rig: RunningRig) -> Generator[Any]:
    with stock_client(rig) as found:
        until(lambda: found.Microgripper.RigState.get() != "unknown", "it does not answer")
        yield found


def test_both_arms_grip_and_release(rig: RunningRig, client: Any) -> None:
    gripper = client.Microgripper
    assert gripper.Plan(FORCE_MN, 0.0, "").Feasible is True
    grip = gripper.Grip(FORCE_MN, 0.0, "")
    shares: list[float] = []
    phases: set[str] = set()
    for one in grip.subscribe_to_intermediate_responses():
        phases.add(one.Sample.Phase)
        shares.append(grip.progress or 0.0)
    held = responses(grip)
    assert held.Outcome == "held"
    assert abs(held.HeldForce - FORCE_MN) < NEAR_MN
    assert {"approach", "load", "hold"} <= phases
    assert any(0.1 < share < 0.9 for share in shares)
    assert shares == sorted(shares)
    first = next(iter(gripper.ContactForce.subscribe()))
    second = next(iter(client.SecondArm.ContactForce.subscribe()))
    newest = rig.view()["newest"]
    assert abs(first.Force - FORCE_MN) < NEAR_MN
    assert abs(second.Force - FORCE_MN) < NEAR_MN
    assert second.Position == pytest.approx(newest["second_x_um"], abs=1.0)
    assert second.Voltage == pytest.approx(newest["second_voltage_V"], abs=0.1)
    assert second.Place == pytest.approx(0.5 * (first.Position - second.Position), abs=0.2)
    assert rig.job(held.Job)["kind"] == "grip"
    assert responses(gripper.Release()).Job == held.Job
    result = rig.ended(held.Job)["result"]
    assert held.HeldForce == pytest.approx(result["force_held_mN"], abs=0.3)


def test_requests_that_break_a_limit_are_refused_with_value_unit_and_limit(client: Any) -> None:
    words = "force 500.000 mN above the limit 40 mN"
    error = refusal(client.Microgripper.Grip(500.0, 0.0, ""))
    assert error.identifier == "LimitViolation"
    assert words in error.message
    plan = client.Microgripper.Plan(500.0, 0.0, "")
    assert plan.Feasible is False
    assert words in plan.Violations[0]


def test_commands_for_one_arm_are_refused_with_a_reason(client: Any) -> None:
    error = refusal(client.Microgripper.Track("sinusoid", FORCE_MN, 2.0, 1.0, 1, ""))
    assert error.identifier == "InvalidRequest"
    assert "cycles is for 1 driven arm, and this rig has 2" in error.message
