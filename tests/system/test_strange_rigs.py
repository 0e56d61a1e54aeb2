"""Random unusual rigs, brought up over REST by the checklist alone, and badly treated."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.support.strange_rigs import COUNT, OFF, Treated, treat

MOST_WRONG = 0.05
"""Largest share of held grips whose force error may exceed its uncertainty, U = 2σ. Among four
grips at least one exceeds it with a probability of 19 %."""
NEVER_WRONG = 1.5
"""Multiple of its uncertainty that no force error may exceed."""


def judge(treated: Sequence[Treated]) -> None:
    """Check that no force exceeds its limit, no force is confidently wrong, and no proposal is
    wrong."""
    for rig in treated:
        assert rig.peak[1] <= rig.limit_mN, str(rig)
        assert not rig.proposed, str(rig)
        assert "contact" in rig.part_left or "kink" in rig.part_left, str(rig)
        assert {name for name, share in rig.off.items() if abs(share) > OFF} == set(), str(rig)
    held = [one for rig in treated for one in rig.held]
    wrong = [(error_mN, u_mN) for error_mN, u_mN in held if abs(error_mN) > u_mN]
    assert held
    assert len(wrong) <= max(1.0, MOST_WRONG * len(held)), (wrong, len(held))
    assert all(abs(error_mN) <= NEVER_WRONG * u_mN for error_mN, u_mN in wrong), wrong


def played(folder: Path, seeds: Sequence[int]) -> list[Treated]:
    treated: list[Treated] = []
    for seed in seeds:
        place = folder / str(seed)
        place.mkdir()
        treated.append(treat(seed, place))
        print(treated[-1], flush=True)
    return treated


def test_an_unusual_rig_of_each_hysteresis_class_reports_correct_results(tmp_path: Path) -> None:
    judge(played(tmp_path, (1, 2)))


@pytest.mark.slow
def test_twenty_unusual_rigs_report_correct_results(tmp_path: Path) -> None:
    judge(played(tmp_path, range(1, COUNT + 1)))
