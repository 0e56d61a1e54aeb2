"""Links are cut again and again: all is ready soon after, each cut is reported, and no resources
leak.

``PINCETTE_CUTS`` is the number of cuts in the slow test, plain and secure, and
``PINCETTE_LONGEST_S`` the duration of the longest.
"""

import os
from pathlib import Path

import pytest

from tests.support.cuts import LONGEST_S, SEED, cuts, figures_of
from tests.support.namespaces import objection

pytestmark = pytest.mark.usefixtures("stalls")

FEW, SHORTLY_S = 6, 2.0
MANY = int(os.environ.get("PINCETTE_CUTS", "300"))
LONG_S = float(os.environ.get("PINCETTE_LONGEST_S", str(LONGEST_S)))
FILES, THREADS = 6.0, 3.0
"""Largest difference between the means of the two halves of the cuts: a lost link stays open for
a while."""


@pytest.fixture(scope="module", autouse=True)
def permitted() -> None:
    """Skip if this account may not create a network."""
    if why := objection():
        pytest.skip(why)


@pytest.mark.parametrize(
    ("secure", "count", "longest_s"),
    [
        (True, FEW, SHORTLY_S),
        *(pytest.param(one, MANY, LONG_S, marks=pytest.mark.slow) for one in (False, True)),
    ],
)
def test_after_a_cut_all_links_recover_soon_and_each_is_reported(
    count: int, longest_s: float, secure: bool, tmp_path: Path, figures: list[str]
) -> None:
    found = cuts(tmp_path / "cuts.json", count, longest_s, SEED, secure=secure)
    figures += figures_of(found)
    assert found["failures"] == []
    assert len(found["made"]) == count
    for name, grown in found["grown"].items():
        assert grown["files"] <= FILES, name
        # Zenoh's pool of threads fills up in the first cuts: only many cuts show whether that ends.
        assert count < MANY or grown["threads"] <= THREADS, name
