"""The links of one program are cut in one direction, in a separate network; T = 20 ms.

The cut ends while the voltage of a held part is still frozen, or after the ramp. In both cases the
rig stays as it is until a person resets it. `test_soak_faults.py` cuts both directions.
"""

from pathlib import Path

import pytest

from tests.support.distributions import injections_of, table
from tests.support.namespaces import objection
from tests.support.soak import injected

pytestmark = pytest.mark.usefixtures("stalls")

FEW, MANY = 2, 20
"""Number of cuts of each kind, half of them with a part held; for every commit and for the soak."""


@pytest.fixture(scope="module", autouse=True)
def permitted() -> None:
    """Skip if this account may not create a network."""
    if why := objection():
        pytest.skip(why)


@pytest.mark.parametrize(
    ("kinds", "programs", "rounds"),
    [
        (["mute", "deaf"], ["controller"], FEW),
        pytest.param(["mute"], ["controller", "estimator", "sensor"], MANY, marks=pytest.mark.slow),
        pytest.param(["deaf"], ["controller", "estimator"], MANY, marks=pytest.mark.slow),
    ],
)
def test_a_program_that_is_cut_off_in_one_direction_makes_the_rig_safe_in_time(
    kinds: list[str], programs: list[str], rounds: int, tmp_path: Path, figures: list[str]
) -> None:
    words = ["--rounds", str(rounds), "--kinds", *kinds, "--programs", *programs]
    count = rounds * len(kinds) * len(programs)
    found = injected(tmp_path / "cut.json", words, count, own_network=True)
    figures += table(found["rows"]).splitlines()
    figures += found["outliers"]
    assert found["failures"] == []
    made = injections_of(found)
    assert len(made) == count
    assert [line for one in made if not one.within for line in one.outliers()] == []
