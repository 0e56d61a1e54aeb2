"""Units follow from the suffixes of names."""

import pytest

from pincette.core.units import bare, unit_of


@pytest.mark.parametrize(
    ("name", "unit", "rest"),
    [
        ("contact_stiffness_mN_per_um", "mN/µm", "contact_stiffness"),
        ("force_mN", "mN", "force"),
        ("slew_V_per_s", "V/s", "slew"),
        ("rmse_percent", "%", "rmse"),
        ("samples", "", "samples"),
        ("t_s", "s", "t"),
    ],
)
def test_the_printed_units_are_off_by_the_stated_factors(name: str, unit: str, rest: str) -> None:
    assert unit_of(name) == unit
    assert bare(name) == rest
