"""U on the way back from a press covers the error that rehearsals found there."""

from math import sqrt

import pytest
from msgspec.structs import replace

from pincette.control.force.estimation import COVERAGE
from pincette.control.response.stroke_check import StrokeChange
from pincette_estimator.config import configure

from .bench import TAUGHT, Bench, a_rig

RETURN_UM, TURN_UM_PER_V = 0.8, 1.4
ZERO_V, TOP_V, STEP_V = 1.0, 2.0, 0.02
CREPT_V = 0.12
"""Fall of the voltage that creep causes in a hold, in V."""


def stated_mN(
    return_error_um: float | None, turn_error_um_per_V: float | None = None
) -> dict[str, float]:
    """Return U at the top of a press, two falls below it, and back at the voltage of the zero."""
    errors = {"return_error_um": return_error_um, "turn_error_um_per_V": turn_error_um_per_V}
    taught = TAUGHT.model_copy(update=errors)
    bench = Bench(configure(a_rig(taught)))

    def at(voltage_V: float, *, zero: bool = False) -> float:
        x_um = bench.state.arms[0].response.position_um()
        return bench.feed(x_um, voltage_V, zero=zero).arms[0].force_uncertainty_mN

    for _ in range(40):
        at(ZERO_V)
    at(ZERO_V, zero=True)
    steps = round((TOP_V - ZERO_V) / STEP_V)
    rising = [at(ZERO_V + STEP_V * step) for step in range(1, steps + 1)]
    falling = [at(TOP_V - STEP_V * step) for step in range(1, steps + 1)]
    crept = falling[round(CREPT_V / STEP_V) - 1]
    return {"top": rising[-1], "below": falling[1], "crept": crept, "back": falling[-1]}


def test_the_force_uncertainty_on_the_return_includes_the_error_of_rehearsed_returns() -> None:
    without, stated = stated_mN(None), stated_mN(RETURN_UM)
    assert stated["top"] == pytest.approx(without["top"])
    assert stated["below"] == pytest.approx(without["below"])
    # Both contain the effect of the unknown history; without the error x_1 is certain at the
    # voltage of its zero.
    by_um = COVERAGE / a_rig(TAUGHT).model.compliance_um_per_mN
    more_mN2 = stated["back"] ** 2 - without["back"] ** 2
    assert more_mN2 == pytest.approx((by_um * RETURN_UM) ** 2, rel=1e-6)


def test_creep_during_a_hold_does_not_add_the_full_error_of_the_return() -> None:
    """When the voltage of a hold had crept down by 0.1 V, U rose from 1.5 to 2 mN in one tick."""
    without, stated = stated_mN(None), stated_mN(RETURN_UM)
    by_um = COVERAGE / a_rig(TAUGHT).model.compliance_um_per_mN
    more_mN2 = stated["crept"] ** 2 - without["crept"] ** 2
    assert 0.0 < more_mN2 < 0.03 * (by_um * RETURN_UM) ** 2


def test_the_slope_error_after_a_reversal_grows_with_the_fall_and_ends_on_the_return() -> None:
    """A hold of 11.1 mN was off by 0.51 mN, where 0.33 mN were stated, after a fall of 0.09 V."""
    without, stated = stated_mN(RETURN_UM), stated_mN(RETURN_UM, TURN_UM_PER_V)
    by_um = COVERAGE / a_rig(TAUGHT).model.compliance_um_per_mN
    more_mN2 = {place: stated[place] ** 2 - without[place] ** 2 for place in stated}
    assert more_mN2["top"] == more_mN2["back"] == pytest.approx(0.0)
    turned_mN2 = (by_um * TURN_UM_PER_V) ** 2
    assert more_mN2["below"] == pytest.approx(turned_mN2 * (2.0 * STEP_V) ** 2)
    assert more_mN2["crept"] == pytest.approx(turned_mN2 * CREPT_V**2, rel=0.05)


def test_after_a_small_stroke_change_the_uncertainty_grows_with_the_travel_since_the_zero() -> None:
    """A stroke 0.73 % larger, of which the strokes show 0.9 %, causes an error of 0.25 mN at 16
    mN."""

    def squared_mN2(stroke: StrokeChange | None) -> float:
        bench = Bench(configure(a_rig(TAUGHT)))
        bench.rest(0.0, 0.0, 40)
        bench.feed(0.0, 0.0, zero=True)
        arm = replace(bench.state.arms[0], stroke=stroke)
        bench.state = replace(bench.state, arms=(arm,))
        return bench.feed(10.0, TOP_V).arms[0].force_uncertainty_mN ** 2

    model, without_mN2 = a_rig(TAUGHT).model, squared_mN2(None)
    error_um = 0.005 * TOP_V * model.piezo_um_per_V / sqrt(3.0)
    more_mN2 = squared_mN2(StrokeChange(0.004, 0.009)) - without_mN2
    assert more_mN2 == pytest.approx((COVERAGE * error_um / model.compliance_um_per_mN) ** 2)
    assert squared_mN2(StrokeChange(0.004, 0.009, rested=False)) == without_mN2
