"""Release of parts that stick to the arm: strategies, verdict and pull-off force."""

from collections import Counter

import pytest

from pincette.api.results import confirmations
from tests.support.released import Bench, adhesive_rig, random_part
from tests.support.two_arms import SHORT_PAIR, two_arm_rig

GLUED = {"bond_mN": 200.0, "bond_scale_mN": 10.0}
DRY = {"adhesion_J_per_m2": 0.1}


def test_a_free_part_is_released_by_the_first_strategy() -> None:
    bench = Bench(adhesive_rig())
    bench.grip(15.0)
    found = bench.release(strategies=["retreat", "dither", "wait"])
    assert (found.verdict.verdict, found.verdict.strategies) == ("released", ["retreat"])
    assert found.record.fault == ""
    assert found.result.outcome == "released"
    assert [phase.phase for phase in found.result.phases] == ["unload", "check"]


def test_a_glued_part_sticks_after_every_strategy() -> None:
    bench = Bench(adhesive_rig(GLUED))
    bench.grip(15.0)
    found = bench.release(strategies=["retreat", "fast", "dither", "wait"], wait_s=1.0)
    assert not found.free
    assert found.verdict.verdict == "sticks"
    assert found.verdict.strategies == ["retreat", "fast", "dither", "wait"]
    stiffness, doubt = (
        found.verdict.stiffness_mN_per_um,
        found.verdict.stiffness_uncertainty_mN_per_um,
    )
    assert stiffness is not None
    assert doubt is not None
    assert stiffness == pytest.approx(2.11, abs=doubt)
    assert "the part sticks" in found.record.fault
    assert found.verdict.pull_off_mN is None


@pytest.mark.parametrize(
    ("strategies", "wishes"),
    [(["retreat", "wait"], {"wait_s": 20.0}), (["retreat", "dither"], {"dither_um": 4.0})],
)
def test_a_later_strategy_releases_a_part_that_sticks_after_the_first(
    strategies: list[str], wishes: dict[str, float]
) -> None:
    """A bond that withstands the static pull of 27 mN for seconds breaks after some time or
    under a larger pull."""
    bench = Bench(adhesive_rig({"bond_mN": 31.5, "bond_scale_mN": 1.5}))
    bench.grip(15.0)
    found = bench.release(strategies=strategies, **wishes)
    assert found.free
    assert (found.verdict.verdict, found.verdict.strategies) == ("released", strategies)


@pytest.mark.parametrize(("adhesion", "true_mN"), [(0.0, 0.0), (0.1, 0.33), (0.3, 0.99)])
def test_the_pull_off_force_is_found_in_a_slow_retreat(adhesion: float, true_mN: float) -> None:
    bench = Bench(adhesive_rig({"adhesion_J_per_m2": adhesion}))
    bench.grip(15.0)
    found = bench.release(release_s=40.0).verdict
    pull_mN, doubt_mN = found.pull_off_mN, found.pull_off_uncertainty_mN
    assert pull_mN is not None
    assert doubt_mN is not None
    assert pull_mN == pytest.approx(true_mN, abs=doubt_mN)
    assert (pull_mN > 0.0) == (true_mN > 0.0)


@pytest.mark.parametrize(("part", "verdict"), [(DRY, "released"), (GLUED, "sticks")])
def test_a_grip_states_how_its_release_went(part: dict[str, float], verdict: str) -> None:
    """An arm that is still pulled by the part has not returned free: it has no zero return."""
    found = Bench(adhesive_rig(part)).grip(15.0, hold_s=1.0)
    result = found.record.result
    assert found.verdict.verdict == verdict
    assert found.free == (verdict == "released")
    assert (getattr(result, "zero_return", None) is None) == (verdict == "sticks")
    reported = [words for words, _ in confirmations(found.record.tree)]
    assert ("the part sticks to the arm" in reported) == (verdict == "sticks")
    assert not ("the part sticks to the arm" in reported and "zero return" in " ".join(reported))


def test_two_arms_release_a_part_that_lies_between_them() -> None:
    bench = Bench(two_arm_rig(SHORT_PAIR))
    bench.grip(10.0)
    found = bench.release(strategies=["retreat", "wait"])
    assert (found.verdict.verdict, found.verdict.strategies) == ("released", ["retreat"])


@pytest.mark.parametrize(
    ("pull_off_mN", "verdict"), [([300.0, 300.0], "sticks"), ([300.0, 0.0], "unknown")]
)
def test_a_part_that_sticks_to_one_of_two_arms_is_not_released(
    pull_off_mN: list[float], verdict: str
) -> None:
    """A part that sticks to both arms holds them; one arm alone drags it over the ground."""
    rig = two_arm_rig(SHORT_PAIR, {"simulation": {"pair": {"pull_off_mN": pull_off_mN}}})
    assert Bench(rig).grip(10.0, hold_s=0.5).verdict.verdict == verdict
    bench = Bench(rig)
    bench.grip(10.0)
    assert bench.release(strategies=["retreat"]).verdict.verdict == verdict


@pytest.mark.parametrize(
    ("at", "action", "verdict"),
    [
        (("check", 30), "pause", "sticks"),
        (("dither", 30), "pause", "sticks"),
        (("check", 30), "stop", None),
    ],
)
def test_a_release_is_paused_or_stopped(
    at: tuple[str, int], action: str, verdict: str | None
) -> None:
    """A pause delays the verdict; a stopped release keeps the part and has no verdict."""
    bench = Bench(adhesive_rig(GLUED))
    bench.grip(15.0)
    bench.requests = {at: action, ("stopped", 30): "keep"}
    found = bench.release(strategies=["dither"])
    assert (found.stated and found.stated.verdict) == verdict
    assert found.result.outcome == ("stopped" if action == "stop" else "released")


def judged(seeds: range) -> Counter[tuple[str, bool]]:
    """Release random parts; count verdicts and whether the simulated arm was free.

    A job that states no verdict, as after a trip, counts as unknown.
    """
    counts = Counter[tuple[str, bool]]()
    for seed in seeds:
        rig, force_mN, strategies = random_part(seed)
        bench = Bench(rig)
        if seed % 2:
            found = bench.grip(force_mN, hold_s=1.0)
        else:
            bench.grip(force_mN)
            wishes = {"wait_s": 3.0} if "wait" in strategies else {}
            found = bench.release(strategies=strategies, **wishes)
        verdict = "unknown" if found.stated is None else found.stated.verdict
        counts[verdict, found.free] += 1
        if verdict != ("released" if found.free else "sticks"):
            print(f"seed {seed}: {found.result.outcome}, {found.stated}, free {found.free}")
    return counts


def is_right(counts: Counter[tuple[str, bool]]) -> bool:
    """Return whether at least 99 % of the verdicts are right and at most 5 % of all are unknown."""
    unknown = sum(count for (verdict, _), count in counts.items() if verdict == "unknown")
    wrong = counts["released", False] + counts["sticks", True]
    known = counts.total() - unknown
    print(f"{counts}: {wrong} of {known} wrong, {unknown} of {counts.total()} unknown")
    return wrong <= 0.01 * known and unknown <= 0.05 * counts.total()


def test_verdicts_on_a_few_random_parts_are_right() -> None:
    counts = judged(range(8))
    assert is_right(counts)
    assert counts["released", True]


def test_verdicts_on_two_hundred_random_parts_are_right() -> None:
    counts = judged(range(1000, 1200))
    assert is_right(counts)
    assert counts["released", True] > 50
    assert counts["sticks", False] > 20
