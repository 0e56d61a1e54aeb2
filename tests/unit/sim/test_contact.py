import pytest
from hypothesis import given
from hypothesis import strategies as st

from pincette.sim.plant.contact import (
    ball_weight_mN,
    capillary_mN,
    hertz_um_per_mN23,
    holding_force_mN,
    pull_off_mN,
    static_force_mN,
)


def test_the_hertz_contact_of_the_small_ball_is_indented_by_25_nm_at_1_mN() -> None:
    """The project's facts of instruments; E* of glass on glass is 37 GPa, near the 37.95 here."""
    assert hertz_um_per_mN23(25.0, 37.95) == pytest.approx(0.025, rel=1e-4)
    glass_GPa = 70.0 / (2.0 * (1.0 - 0.22**2))
    assert hertz_um_per_mN23(25.0, glass_GPa) == pytest.approx(0.025, rel=0.03)


def test_weight_and_adhesion_of_the_papers_bead_are_as_calculated() -> None:
    assert ball_weight_mN(700.0, 2500.0) == pytest.approx(0.035, rel=0.01)
    assert pull_off_mN(700.0, 0.05, 1.0) == pytest.approx(0.165, rel=0.01)
    assert pull_off_mN(700.0, 0.1, 1.0) == pytest.approx(0.33, rel=0.01)
    assert pull_off_mN(700.0, 0.1, 0.0) == 0.0
    assert capillary_mN(700.0, 0.072) == pytest.approx(0.633, rel=0.001)
    assert holding_force_mN(0.035, 0.3) == pytest.approx(0.0583, rel=0.001)


@given(st.floats(1e-9, 60.0), st.floats(0.1, 3.0), st.floats(0.0, 1.0))
def test_the_static_force_satisfies_the_equilibrium_equation(
    overlap_um: float, s: float, b: float
) -> None:
    force_mN = static_force_mN(overlap_um, s, b)
    assert s * force_mN + b * force_mN ** (2.0 / 3.0) == pytest.approx(overlap_um, rel=1e-9)


def test_without_overlap_there_is_no_force() -> None:
    assert static_force_mN(-1.0, 1.0, 0.01) == static_force_mN(0.0, 1.0, 0.01) == 0.0
