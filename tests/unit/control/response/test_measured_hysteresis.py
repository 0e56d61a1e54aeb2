"""The identification on a measured piezo stack, on cycles that it was not fitted to."""

from pathlib import Path

import numpy as np
import pytest

from pincette.control.response.identification import Candidates, identify_free_response

PERIOD_S = 0.02
PLAIN = Candidates(families=((0.0,),), ridges=(1e-6,))
EVERY = 4
"""Rows are 5 ms apart."""
MEASURED = Path(__file__).parents[4].parent / "shared/data/piezo-stack-hysteresis/Model_Vi_Do.dat"


def measured(lag: int) -> tuple[list[float], list[float]]:
    """Voltage in V, and displacement in µm that many samples later."""
    # The record is another's, and the project must not contain it.
    if not MEASURED.exists():
        pytest.skip("the measured hysteresis of a piezo stack is not beside this checkout")
    rows = np.loadtxt(MEASURED)[::EVERY]
    return rows[: len(rows) - lag, 0].tolist(), rows[lag:, 4].tolist()


@pytest.mark.parametrize(
    ("curved", "limit"), [((False,), 0.008), ((False, True), 0.005)], ids=["plays", "curved"]
)
@pytest.mark.parametrize("lag", [0, 1])
@pytest.mark.parametrize("held_out", [0.3, 0.5])
def test_a_measured_piezo_stack_is_followed(
    curved: tuple[bool, ...], limit: float, lag: int, held_out: float
) -> None:
    voltage_V, x_um = measured(lag)
    found = identify_free_response(
        voltage_V,
        x_um,
        PERIOD_S,
        candidates=PLAIN._replace(curved=curved),
        unpoled=False,
        held_out=held_out,
    )
    assert found.residual_um < limit * (max(x_um) - min(x_um))


def test_a_measured_piezo_stack_gives_no_reason_for_fading() -> None:
    voltage_V, x_um = measured(1)
    found = identify_free_response(voltage_V, x_um, PERIOD_S, unpoled=False)
    plain = identify_free_response(
        voltage_V, x_um, PERIOD_S, unpoled=False, candidates=PLAIN._replace(curved=(False, True))
    )
    print(found, plain)
    assert found.model.fadings_per_V == ()
