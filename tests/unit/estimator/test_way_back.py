"""U on the way back from a press covers the error that rehearsals found there."""

import pytest

from pincette.control.force.estimation import COVERAGE
from pincette_estimator.config import configure

from .bench import TAUGHT, Bench, a_rig

RETURN_UM = 0.8
ZERO_V, TOP_V, STEP_V = 1.0, 2.0, 0.02
CREPT_V = 0.12
"""Fall of the voltage that creep makes in a hold."""


def stated_mN(return_error_um: float | None) -> dict[str, float]:
    """Return U at the top of a press, two falls below it, and U back at the place of the zero."""
    taught = TAUGHT.model_copy(update={"return_error_um": return_error_um})
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


def test_U_on_the_way_back_is_at_least_the_error_of_rehearsed_ways_back() -> None:
    without, stated = stated_mN(None), stated_mN(RETURN_UM)
    assert stated["top"] == pytest.approx(without["top"])
    assert stated["below"] == pytest.approx(without["below"])
    # What the unfollowed past may do is in both; without the error x_1 is sure where it was zeroed.
    by_um = COVERAGE / a_rig(TAUGHT).model.compliance_um_per_mN
    more_mN2 = stated["back"] ** 2 - without["back"] ** 2
    assert more_mN2 == pytest.approx((by_um * RETURN_UM) ** 2, rel=1e-6)


def test_creep_in_a_hold_does_not_bring_the_error_of_the_whole_way_back() -> None:
    """Where the voltage of a hold had crept down by 0.1 V, U rose from 1.5 to 2 mN in one tick."""
    without, stated = stated_mN(None), stated_mN(RETURN_UM)
    by_um = COVERAGE / a_rig(TAUGHT).model.compliance_um_per_mN
    more_mN2 = stated["crept"] ** 2 - without["crept"] ** 2
    assert 0.0 < more_mN2 < 0.03 * (by_um * RETURN_UM) ** 2
