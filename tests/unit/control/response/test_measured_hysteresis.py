"""The identification on a measured piezo stack, on cycles that were not used for the fit."""

from pathlib import Path

import numpy as np
import pytest

from pincette.control.response.hysteresis_motion import simulate
from pincette.control.response.identification import Candidates, identify_free_response

PERIOD_S = 0.02
PLAIN = Candidates(families=((0.0,),), ridges=(1e-6,))
ROW_S, EVERY = 0.005, 4
HELD_OUT = 0.25
MEASURED = Path(__file__).parents[4].parent / "shared/data/piezo-stack-hysteresis/Model_Vi_Do.dat"


def measured(lag: int, every: int = EVERY) -> tuple[list[float], list[float]]:
    """Voltage in V, and displacement in µm at a later sample, by the given delay."""
    # The record belongs to others, and the project must not contain it.
    if not MEASURED.exists():
        pytest.skip("the measured hysteresis of a piezo stack is not beside this checkout")
    rows = np.loadtxt(MEASURED)[::every]
    return rows[: len(rows) - lag, 0].tolist(), rows[lag:, 4].tolist()


@pytest.mark.parametrize(
    ("curved", "limit", "lag", "held_out"),
    [((False,), 0.008, 0, 0.3), ((False, True), 0.005, 1, 0.5)],
    ids=["plays", "curved"],
)
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


def test_a_measured_piezo_stack_gives_no_evidence_of_fading() -> None:
    voltage_V, x_um = measured(1)
    found = identify_free_response(voltage_V, x_um, PERIOD_S, unpoled=False)
    plain = identify_free_response(
        voltage_V, x_um, PERIOD_S, unpoled=False, candidates=PLAIN._replace(curved=(False, True))
    )
    print(found, plain)
    assert found.model.fadings_per_V == ()


@pytest.mark.parametrize(("every", "lag"), [(1, 0), (4, 1)], ids=["5 ms", "20 ms"])
def test_the_returned_model_has_the_stated_residual_at_every_period(every: int, lag: int) -> None:
    voltage_V, x_um = (np.array(values) for values in measured(lag, every))
    period_s = every * ROW_S
    found = identify_free_response(
        voltage_V.tolist(), x_um.tolist(), period_s, unpoled=False, held_out=HELD_OUT
    )
    left_um = x_um - simulate(found.model, voltage_V, period_s)
    own_um = float(np.std(left_um[int(len(x_um) * (1.0 - HELD_OUT)) :]))
    print(f"own residual {100.0 * own_um / np.ptp(x_um):.2f} % of the range")
    assert found.residual_um == pytest.approx(own_um, rel=1e-9)
    assert own_um < 0.008 * np.ptp(x_um)
    assert min(found.model.creep_fractions) >= 0.0


@pytest.mark.parametrize(("lead_s", "unpoled"), [(4.0, False), (40.0, True)])
def test_a_measured_stack_that_rests_first_is_followed(lead_s: float, unpoled: bool) -> None:
    voltage_V, x_um = (np.array(values) for values in measured(0))
    rest = round(lead_s / PERIOD_S)
    u, x = np.pad(voltage_V, (rest, 0), "edge"), np.pad(x_um, (rest, 0), "edge")
    found = identify_free_response(u.tolist(), x.tolist(), PERIOD_S, unpoled=unpoled)
    left_um = (x - simulate(found.model, u, PERIOD_S))[len(u) // 2 :]
    assert float(np.std(left_um)) < 0.015 * np.ptp(x_um)
