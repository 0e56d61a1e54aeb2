"""Warnings and violations of a plan whose steps excite the mode."""

from typing import Any

import pytest

from pincette.api.plans import Plan
from pincette.config import RigFile
from pincette.diagnostics.rig_file import ring
from pincette_supervisor.kinds.bodies import REQUEST
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Present
from tests.support.fast_output import RC_S, Kind, fast_rig
from tests.support.rigs import demo_rig

TRACK: dict[str, Any] = {
    "kind": "track",
    "shape": "sinusoid",
    "force_mean_mN": 12.0,
    "force_pp_mN": 16.0,
    "cycles": 4,
}


def planned(rig: RigFile, frequency_hz: float, **wish: Any) -> Plan:
    request = REQUEST.validate_python({**TRACK, "frequency_hz": frequency_hz, **wish})
    plan = plan_job(request, rig, Present(0.0, 0.0)).plan
    assert isinstance(plan, Plan)
    return plan


@pytest.mark.parametrize("frequency_hz", [2.0, 5.0])
def test_a_tolerance_that_the_ring_exceeds_is_refused_with_both_numbers(
    frequency_hz: float,
) -> None:
    plan = planned(fast_rig("one write"), frequency_hz, force_tolerance_mN=0.5)
    (found,) = plan.violations
    assert (found.pointer, found.quantity, found.unit) == ("/force_tolerance_mN", "force", "mN")
    assert found.limit == 0.5
    assert found.value == pytest.approx(1.27 * frequency_hz, rel=0.05)
    assert "shaping" in found.message


@pytest.mark.parametrize("kind", ["three writes", "RC"])
@pytest.mark.parametrize("frequency_hz", [2.0, 5.0])
def test_with_shaping_or_an_rc_filter_the_same_plan_is_accepted(
    frequency_hz: float, kind: Kind
) -> None:
    plan = planned(fast_rig(kind), frequency_hz, force_tolerance_mN=1.0)
    assert plan.feasible
    assert not plan.warnings


def test_without_a_tolerance_a_large_ring_is_a_warning_with_its_remedy() -> None:
    plan = planned(fast_rig("one write"), 2.0)
    assert plan.feasible
    (warning,) = plan.warnings
    assert "2.60 mN" in warning
    assert "shaping" in warning
    assert not planned(fast_rig("one write"), 0.5).warnings


def test_on_a_line_too_slow_for_shaping_an_rc_filter_is_recommended() -> None:
    lagless = {"model": {"output_delay_s": 0.005}, "limits": {"slew_V_per_s": 40.0}}
    rig = demo_rig(lagless, time="lockstep")
    (warning,) = planned(rig, 2.0).warnings
    assert "RC of 3.3 ms" in warning
    faster = rig.track.model_copy(update={"frequency_hz": 2.0})
    (found,) = ring(rig.model_copy(update={"track": faster}))
    assert found.mark == "note"
    assert "RC of 3.3 ms" in found.remedy


def test_an_output_with_a_lag_causes_no_warning() -> None:
    rig = demo_rig({"limits": {"slew_V_per_s": 40.0}}, time="lockstep")
    assert not planned(rig, 2.0).warnings


def test_doctor_recommends_shaping_if_the_output_can_time_it() -> None:
    fast = {"track": {"frequency_hz": 2.0}}
    (found,) = ring(fast_rig("one write", fast))
    assert (found.mark, "shaping = true" in found.remedy) == ("note", True)
    for kind in ("three writes", "RC"):
        assert [one.mark for one in ring(fast_rig(kind, fast))] == ["ok"]


def test_doctor_reports_that_the_uncertainty_excludes_the_ring_if_the_output_delay_is_missing() -> (
    None
):
    tree = fast_rig("one write", {"track": {"frequency_hz": 2.0}})
    model = tree.model.model_copy(update={"output_delay_s": None})
    first, _ = ring(tree.model_copy(update={"model": model}))
    assert first.mark == "note"
    assert "output_delay_s = 0.0" in first.remedy


def test_doctor_refuses_shaping_if_the_output_cannot_time_it() -> None:
    rig = demo_rig({"output": {"shaping": True}})
    (found,) = ring(rig)
    assert found.mark == "missing"
    assert f"{1e3 * RC_S:.1f} ms" in found.remedy
