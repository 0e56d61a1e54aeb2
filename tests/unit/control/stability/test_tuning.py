"""The search for gains: its trade-off, its criteria, and the motions that it plays."""

from dataclasses import replace
from math import cos, pi

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pincette.control.laws.definition import LawSettings
from pincette.control.response.free_response import FreeSample, nominal_response
from pincette.control.stability.tuning import (
    Candidate,
    TuningPath,
    TuningRig,
    pareto_front,
    track,
    tune,
)
from tests.support.laws import DSMIFC, LAWS, PBSMIC, default_settings, law_settings
from tests.unit.control.force.exact_arm import OMEGA_N, ZETA
from tests.unit.control.laws.model_loop import ARM, SCHEMES

K_E, PERIOD_S, TOUCH_V = 2.2, 0.02, 1.5
SWING = TuningPath(tuple(10.0 * (1.0 - cos(pi * tick * PERIOD_S)) for tick in range(300)), 100)
"""The two cycles of 0.5 Hz and 20 mN that count."""
REST = TuningPath((10.0,) * 400, 300)
K_P, K_F = (0.2, 0.5, 2.0), (0.0, 2000.0, 5000.0, 10000.0)
GRID = {"K_P": K_P, "K_f": K_F}
RIG = TuningRig(
    arm=ARM,
    natural_frequency_rad_per_s=OMEGA_N,
    damping_ratio=ZETA,
    response=nominal_response(19.0, FreeSample(0.0, 0.0)).updated(TOUCH_V, PERIOD_S),
    stiffness_mN_per_um=K_E,
    stiffness_error=0.02,
    force_error_mN=0.3,
    noise_um=(0.0,) * 400,
    period_s=PERIOD_S,
    delay_s=0.005,
    force_filter_s=0.03,
)

percent = st.integers(0, 12).map(float)
points = st.lists(
    st.builds(Candidate, st.just(law_settings()), percent, percent), min_size=1, max_size=40
)


def at_least_as_good(one: Candidate, other: Candidate) -> bool:
    return (
        one.position_percent <= other.position_percent and one.force_percent <= other.force_percent
    )


@given(points)
@settings(derandomize=True)
def test_the_front_consists_of_points_that_no_other_equals_or_beats(
    candidates: list[Candidate],
) -> None:
    front = pareto_front(candidates)
    for place, member in enumerate(front):
        others = [item for item in candidates if item != member]
        assert not any(at_least_as_good(item, member) for item in others)
        assert member not in front[:place]
    for item in candidates:
        assert any(at_least_as_good(member, item) for member in front)
    positions = [member.position_percent for member in front]
    assert positions == sorted(positions)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_the_chosen_gains_minimize_the_larger_of_both_errors(scheme: str) -> None:
    found = tune(RIG, SWING, LAWS[scheme], lambda _: 0.5, radius_limit=0.97, grid=GRID)
    tried = {(item.settings.gains["K_P"], item.settings.gains["K_f"]) for item in found.candidates}
    assert tried == {(proportional, gain) for proportional in K_P for gain in K_F}
    assert {item.settings.scheme for item in found.candidates} == {scheme}
    assert found.front == pareto_front(found.candidates)
    assert found.chosen in found.front
    assert len(found.front) > 1
    larger = [max(item.position_percent, item.force_percent) for item in found.candidates]
    chosen = found.chosen
    assert max(chosen.position_percent, chosen.force_percent) == min(larger)
    assert found.radius == 0.5


class Radius:
    """A radius that depends on K_P only, and the laws for which it was requested."""

    def __init__(self, of: dict[float, float]) -> None:
        self.of = of
        self.asked: list[LawSettings] = []

    def __call__(self, law: LawSettings) -> float:
        self.asked.append(law)
        return self.of[law.gains["K_P"]]


def test_gains_at_the_stability_limit_are_excluded_and_each_is_checked_once() -> None:
    free = tune(RIG, SWING, PBSMIC, lambda _: 0.5, radius_limit=0.97, grid=GRID)
    best = free.chosen.settings.gains["K_P"]
    radius = Radius({gain: 0.97 if gain == best else 0.9 for gain in K_P})
    found = tune(RIG, SWING, PBSMIC, radius, radius_limit=0.97, grid=GRID)
    assert best not in {item.settings.gains["K_P"] for item in found.front}
    assert found.chosen in found.front
    assert found.radius == 0.9
    left = {item.settings for item in found.candidates}
    refused = [law.gains["K_P"] for law in radius.asked if law not in left]
    assert refused
    assert set(refused) == {best}
    assert len(set(radius.asked)) == len(radius.asked)
    assert {item.settings for item in found.front} <= set(radius.asked)
    # A candidate that never reaches the Pareto front is never assessed.
    assert len(radius.asked) < len(K_P) * len(K_F)


def test_unstable_gains_are_not_returned() -> None:
    with pytest.raises(ValueError, match=r"at a period of 20 ms: choose a longer period"):
        tune(RIG, SWING, DSMIFC, lambda _: 1.2, radius_limit=0.97, grid={"K_P": (0.5,), "K_f": K_F})


@pytest.mark.parametrize(
    ("rig", "path"),
    [
        (RIG, replace(SWING, settled=300)),
        (replace(RIG, noise_um=(0.0,) * 299), SWING),
    ],
)
def test_a_path_with_too_few_samples_to_evaluate_is_refused(
    rig: TuningRig, path: TuningPath
) -> None:
    with pytest.raises(ValueError, match=r"300 reference samples and .* too few"):
        track(rig, path, law_settings(), K_E, 0.0)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_with_a_perfect_plan_the_error_grows_with_k_p(scheme: str) -> None:
    law = default_settings(scheme, "consistent")
    found = [track(RIG, SWING, law.with_gains(K_P=gain), K_E, 0.0) for gain in (0.0, 0.5, 2.0, 5.0)]
    position = [x_um for x_um, _ in found]
    # 20 mN and 9 µm peak to peak.
    assert position[0] < 1e-3
    assert position == sorted(position)
    assert position[-1] > 3.0 * position[0]
    for x_um, force_mN in found:
        assert force_mN == pytest.approx(K_E * x_um)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("gain", [0.0, 1000.0, 10000.0])
@pytest.mark.parametrize("error_mN", [-0.5, 0.0, 0.5])
@pytest.mark.parametrize("planned", [K_E, 2.4])
def test_the_errors_of_a_law_at_rest_satisfy_equation_51_with_its_force(
    scheme: str, gain: float, error_mN: float, planned: float
) -> None:
    law = default_settings(scheme, "consistent").with_gains(K_f=gain)
    x_um, force_mN = track(RIG, REST, law, planned, error_mN)
    # (51), x_r - x_e = F_r/planned; the law uses F + b for F, so b is subtracted from F_r.
    mismatch_mN = 10.0 - K_E * 10.0 / planned
    stiffness = K_E + law.gains["K"] / gain if gain else float("inf")
    moved_um = (mismatch_mN - error_mN) / stiffness
    assert x_um == pytest.approx(abs(moved_um), abs=1e-9)
    assert force_mN == pytest.approx(abs(K_E * moved_um - mismatch_mN), abs=1e-9)


def test_the_error_of_a_candidate_is_the_rms_value_over_model_and_force_errors_of_both_signs() -> (
    None
):
    found = tune(
        RIG, SWING, PBSMIC, lambda _: 0.5, radius_limit=0.97, grid={"K_P": (0.5,), "K_f": (5000.0,)}
    )
    (candidate,) = found.candidates
    runs = [
        track(RIG, SWING, candidate.settings, K_E * (1.0 + side), read)
        for side in (-0.02, 0.02)
        for read in (-0.3, 0.3)
    ]
    x_square = (runs[0][0] ** 2 + runs[1][0] ** 2 + runs[2][0] ** 2 + runs[3][0] ** 2) / 4.0
    force_square = (runs[0][1] ** 2 + runs[1][1] ** 2 + runs[2][1] ** 2 + runs[3][1] ** 2) / 4.0
    assert candidate.position_percent == pytest.approx(100.0 * x_square**0.5 / (20.0 / K_E))
    assert candidate.force_percent == pytest.approx(100.0 * force_square**0.5 / 20.0)
    assert len({x_um for x_um, _ in runs}) == 4


def test_sensor_noise_moves_the_arm_but_is_not_itself_part_of_the_error() -> None:
    noise = tuple(0.03 if tick % 2 else -0.03 for tick in range(400))
    x_um, _ = track(replace(RIG, noise_um=noise), REST, law_settings(K_f=0.0), K_E, 0.0)
    quiet_um, _ = track(RIG, REST, law_settings(K_f=0.0), K_E, 0.0)
    assert quiet_um < 1e-9
    assert 0.003 < x_um < 0.06
