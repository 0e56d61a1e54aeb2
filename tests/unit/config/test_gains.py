"""Conditions for a law to run on a rig file, and the gains that are found for one."""

from typing import Any

import pytest

from pincette.config import RigFile, gains
from pincette.config.gains import judged, tuned
from pincette.config.reading import laid_over
from pincette.control.laws.parameters import ParameterSet
from pincette.control.stability import tuning
from pincette.control.stability.limits import LIMIT_RADIUS
from pincette.control.stability.loop_matrix import Loop
from pincette.control.stability.tuning import TuningPath, TuningRig
from pincette.control.stability.worst_case import Intervals, worst_case
from tests.support.laws import default_settings, law_settings
from tests.support.rigs import Tree, demo_rig

SCHEMES: tuple[str, ...] = ("pbsmic", "dsmifc")
SETS: tuple[ParameterSet, ...] = ("consistent", "printed")
MOST_TICKS, MOST_RADII = 100_000, 10
"""Cost of a search: ticks played, and spectral radii computed, each of which costs far more than
a track."""
STRAIGHT: Tree = {"model": {"free_response": None, "hysteresis_fraction": 0.03}}
"""An arm whose free response is known as a line only, whatever the demo rig's calibration."""

TAUGHT: dict[str, Tree] = {
    "free_response": {
        "thresholds_V": [0.0],
        "weights_um_per_V": [19.0],
        "creep_times_s": [],
        "creep_fractions": [],
        "fadings_per_V": [],
    },
    "recorded_response": {
        "bottom_V": 0.0,
        "bottom_um": 0.0,
        "top_V": 4.0,
        "top_um": 76.0,
        "ascending": [0.0, 0.5, 1.0],
        "descending": [0.0, 0.5, 1.0],
    },
}
"""The same line, as each source of a free response would state it."""


def rig_of(**tables: Tree) -> RigFile:
    return demo_rig(laid_over(STRAIGHT, tables), time="lockstep")


@pytest.fixture(scope="module")
def rig() -> RigFile:
    return rig_of()


def test_the_laws_of_the_paper_are_admitted_on_the_rig_of_the_paper(rig: RigFile) -> None:
    for scheme in SCHEMES:
        for name in SETS:
            found = judged(rig, default_settings(scheme, name))
            assert found.stable, found.reason
            assert found.limit_radius == LIMIT_RADIUS


@pytest.mark.parametrize("observer", ["inverse_dynamics", "kalman"])
def test_an_unstable_law_is_refused_with_its_radius(observer: str) -> None:
    fast = rig_of(rig={"period_s": 0.001}, model={"force_observer": observer})
    found = judged(fast, law_settings(K_P=1.0))
    assert not found.stable
    assert found.radius > 1.0
    assert f"spectral radius {found.radius:.4g}, limit {found.limit_radius:.4g}" in found.reason
    assert "at a period of 1 ms" in found.reason


def test_the_stability_check_uses_the_part_of_the_rig_file(rig: RigFile) -> None:
    sure = rig_of(part={"stiffness_tolerance": 0.01})
    hard = rig_of(part={"stiffness_mN_per_um": 200.0, "stiffness_tolerance": 0.01})
    law = law_settings(K_P=2.0, K_f=1e5)
    radii = [judged(one, law).radius for one in (sure, rig, hard)]
    assert radii[0] <= radii[1] < radii[2]
    assert judged(hard, law).case.K_e_mN_per_um == pytest.approx(200.0, rel=0.011)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_tuned_gains_are_permitted(
    rig: RigFile, scheme: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    ticks, limits = list[int](), list[float]()

    played = tuning.track

    def tracked(of: TuningRig, path: TuningPath, *others: Any) -> tuple[float, float]:
        ticks.append(len(path.force_r_mN))
        return played(of, path, *others)

    def counted(loop: Loop, met: Intervals, limit: float, *, enough: float) -> Any:
        limits.append(limit)
        return worst_case(loop, met, limit, enough=enough)

    monkeypatch.setattr(gains, "worst_case", counted)
    monkeypatch.setattr(tuning, "track", tracked)
    found = tuned(rig, scheme)
    # A user waits for it: some seconds of processor time.
    assert sum(ticks) <= MOST_TICKS
    assert 0 < len(limits) <= MOST_RADII
    law = found.chosen.settings
    assert (law.scheme, law.set, law.gains["K_S"]) == (scheme, "consistent", 0.0)
    assert judged(rig, law).radius == found.radius < LIMIT_RADIUS
    assert all(judged(rig, item.settings).stable for item in found.front)


def test_gains_for_the_same_rig_file_are_computed_once(rig: RigFile) -> None:
    found = tuned(rig, "pbsmic")
    assert tuned(rig.model_copy(), "pbsmic") is found
    # With other ports it is another rig file, whose search starts again with the same result.
    moved = rig.supervisor.model_copy(update={"port": rig.supervisor.port + 1})
    again = tuned(rig.model_copy(update={"supervisor": moved}), "pbsmic")
    assert again is not found
    assert again == found


def test_an_uncertain_force_reduces_the_weight_of_the_force(rig: RigFile) -> None:
    vague = rig_of(model={"hysteresis_fraction": 0.2})
    sharp, dull = tuned(rig, "pbsmic"), tuned(vague, "pbsmic")
    assert dull.chosen.settings.gains["K_f"] == 0.0 < sharp.chosen.settings.gains["K_f"]
    found = {item.settings: item for item in sharp.candidates}
    both = [(item, found[item.settings]) for item in dull.candidates if item.settings in found]
    assert any(item.settings.gains["K_f"] > 0.0 for item, _ in both)
    for item, before in both:
        if item.settings.gains["K_f"] > 0.0:
            assert item.position_percent > before.position_percent


@pytest.mark.parametrize("name", TAUGHT)
def test_the_model_error_of_an_identified_response_is_its_residual(name: str) -> None:
    """The hysteresis of a line is not used: with it no force would be fed back at all."""
    table = {**TAUGHT[name], "residual_um": 0.001}
    model: Tree = {"free_response": None, "hysteresis_fraction": 0.2, name: table}
    assert tuned(rig_of(model=model), "pbsmic").chosen.settings.gains["K_f"] > 0.0
