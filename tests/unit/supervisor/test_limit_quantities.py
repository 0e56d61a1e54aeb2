"""Plans that break several limits at once name each of them, whatever the quantity."""

from typing import Any, get_args

import pytest

from pincette.api.predictions import Violation
from pincette.control.planning import feasibility
from pincette.control.vocabulary import LimitedQuantity
from pincette_supervisor.plugin.plans import violation_view

from .harness import Harness


@pytest.mark.parametrize("quantity", get_args(LimitedQuantity))
def test_broken_limits_of_every_quantity_are_reported_over_rest(quantity: LimitedQuantity) -> None:
    broken = feasibility.Violation("/x", quantity, 10.0, 5.0, "Hz", 1.0, "10 Hz above 5 Hz")
    seen = violation_view(broken)
    assert Violation.model_validate_json(seen.model_dump_json()) == seen
    assert (seen.quantity, seen.side, seen.value, seen.limit) == (quantity, "above", 10.0, 5.0)


@pytest.mark.parametrize("shape", ["sinusoid", "triangle"])
def test_a_frequency_above_the_limit_is_reported_with_all_other_errors(
    harness: Harness, shape: str
) -> None:
    body = {"kind": "track", "shape": shape, "frequency_hz": 10.0, "force_mean_mN": 35.0}
    plan = harness.post("/jobs", body, dry_run="true").json()
    assert plan["feasible"] is False
    found: dict[str, Any] = {each["quantity"]: each for each in plan["violations"]}
    assert found["frequency"]["pointer"] == "/frequency_hz"
    assert (found["frequency"]["value"], found["frequency"]["limit"]) == (10.0, 5.0)
    assert found["frequency"]["unit"] == "Hz"
    assert {"force", "frequency", "rate"} <= set(found)
