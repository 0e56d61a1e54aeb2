"""The study of the paper from end to end on one random rig: its report, numbers and trends."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from time import monotonic
from typing import Any

import pytest

from pincette.config import read_rig
from pincette_study.beyond import kilohertz
from pincette_study.beyond import tracks as beyond
from pincette_study.command import FAST_RIG
from pincette_study.rigs import random_relay_rig
from pincette_study.study import run_study
from tests.support.rigs import demo_rig

SECTIONS = (
    "short",
    "fig5",
    "fig6",
    "fig7",
    "fig8",
    "table1",
    "fig11",
    "stability",
    "gains",
    "hold",
    "precision",
    "beyond",
    "grip",
    "beyond.kilohertz",
)
SCHEMES = ("pbsmic", "dsmifc")
SWEPT = ("0", "1000", "2000", "3000", "4000", "5000")


@dataclass(frozen=True)
class Study:
    folder: Path
    tree: dict[str, Any]
    summary: dict[str, Any]
    told: list[tuple[str, float]]

    def section(self, key: str) -> dict[str, Any]:
        return self.tree["sections"][key]

    def ours(self, key: str, quantity: str) -> float:
        rows = self.section(key)["comparisons"]
        return next(row["ours"] for row in rows if row["quantity"] == quantity)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    folder = tmp_path_factory.mktemp("paper")
    received: list[tuple[str, float]] = []
    begun = monotonic()
    # The shortest paths that still test what they are for.
    monkeypatch = pytest.MonkeyPatch()
    monkeypatch.setattr(beyond, "CYCLES", {0.5: 2, 2.0: 4, 5.0: 10})
    monkeypatch.setattr(beyond, "LEARNED_CYCLES", 4)
    monkeypatch.setattr(beyond, "AFTER_CYCLES", {0.5: 1, 2.0: 2, 5.0: 5})
    monkeypatch.setattr(kilohertz, "CLASSES", {"relays": random_relay_rig})
    monkeypatch.setattr(kilohertz, "CYCLES", {10.0: 5})
    off = {name: kilohertz.OFF_NOMINAL[name] for name in ("missed_1",)}
    monkeypatch.setattr(kilohertz, "OFF_NOMINAL", off)

    def tell(what: str, share: float) -> None:
        received.append((what, share))

    summary = run_study(demo_rig(), folder, tell, 1, 1, read_rig(FAST_RIG), 1)
    monkeypatch.undo()
    print(f"the study with one random rig took {monotonic() - begun:.1f} s")
    tree = json.loads((folder / "paper.json").read_text(encoding="utf-8"))
    return Study(folder, tree, summary, received)


def falls(values: Sequence[float]) -> bool:
    return all(before > after for before, after in pairwise(values))


def test_the_report_is_complete(study: Study) -> None:
    assert tuple(study.tree["sections"]) == SECTIONS
    assert study.tree["summary"] == study.summary
    page = (study.folder / "index.html").read_text(encoding="utf-8")
    for key in SECTIONS:
        assert f'<section id="{key}">' in page
        assert f'href="#{key}"' in page
        assert study.section(key)["comparisons"]
    pictures = sorted(path.name for path in study.folder.glob("*.png"))
    drawn = ("fig5", "fig6", "fig7", "fig8", "fig9", "fig10", "fig11", "table1", "stability")
    for name in (*drawn, "beyond", "dry_run", "learning", "grips"):
        assert f"{name}.png" in pictures
    assert page.count("<img ") == len(pictures)


def test_progress_is_reported_up_to_the_end(study: Study) -> None:
    shares = [share for _, share in study.told]
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert "random rigs: 1 of 1" in [what for what, _ in study.told]


def test_the_rig_has_the_values_of_figures_5_to_8(study: Study) -> None:
    """The experiments of the study find the parameters of the simulated rig."""
    assert study.ours("fig5", "ω_n²") == pytest.approx(5.943e6, rel=0.02)
    assert study.ours("fig5", "s_p, by a known weight") == pytest.approx(0.46, rel=0.02)
    assert study.ours("fig8", "slope") == pytest.approx(16.0 / 7.45, rel=0.15)


def test_a_smaller_gain_improves_the_errors_of_table_1(study: Study) -> None:
    position = study.summary["table1_position_percent"]
    force = study.summary["table1_force_percent"]
    assert list(position) == list(force) == ["5", "2", "1", "0.5"]
    assert falls([position[gain] for gain in ("5", "2", "1", "0.5")])
    rows = study.section("table1")["data"]["by_K_P"]
    for gain, percent in position.items():
        assert rows[gain]["position_percent"] == percent
        assert 0.5 < percent < 20.0
        assert 0.5 < force[gain] < 20.0
    claims = {trend["claim"]: trend["holds"] for trend in study.section("table1")["trends"]}
    assert claims["position error falls with K_P = 5, 2, 1, 0.5"] is True


def test_a_plan_that_is_too_stiff_trades_position_for_force(study: Study) -> None:
    swept = study.section("fig11")["data"]["consistent set, mismatched plan"]
    assert falls([-swept[gain]["position_percent"] for gain in SWEPT])
    assert falls([swept[gain]["force_percent"] for gain in SWEPT])
    assert "6000" in swept


def test_a_consistent_plan_reduces_both_errors(study: Study) -> None:
    cases = study.section("fig11")["data"]
    for gain in SWEPT[2:]:
        here = cases["consistent set, consistent plan"][gain]
        there = cases["consistent set, mismatched plan"][gain]
        assert here["position_percent"] < there["position_percent"]
        assert here["force_percent"] < there["force_percent"]


def test_a_trend_that_is_not_reproduced_states_why(study: Study) -> None:
    for section in study.tree["sections"].values():
        for trend in section["trends"]:
            assert trend["found"]
            if not trend["holds"]:
                assert len(trend["found"]) > 60, trend


def test_both_laws_track_paths_on_the_random_rigs(study: Study) -> None:
    assert study.summary["random_rigs"] == 1
    trials = study.section("precision")["data"]["trials"]
    assert {trial["scheme"] for trial in trials} == set(SCHEMES)
    assert {trial["frequency_hz"] for trial in trials} == {0.5, 2.0, 5.0}
    floor = study.summary["sensor_floor_percent"]
    # 30 nm of noise and a 25 nm step, relative to 8.45 µm.
    assert floor == pytest.approx(100.0 * (0.03**2 + 0.025**2 / 12.0) ** 0.5 / 8.45)
    for scheme in SCHEMES:
        median = study.summary["tracking_consistent"][scheme]
        worst = study.summary["tracking_consistent_worst"][scheme]
        (slow,) = [t for t in trials if t["scheme"] == scheme and t["frequency_hz"] == 0.5]
        for name in ("position_percent", "force_percent"):
            # Median and worst value of one rig are equal.
            assert median[name] == worst[name] == slow[name]
        assert floor < median["position_percent"] < 5.0
        assert 0.0 < median["force_percent"] < 10.0


def test_results_beyond_the_paper_are_stated_for_every_hysteresis_class_law_and_frequency(
    study: Study,
) -> None:
    assert study.summary["beyond_rigs"] == 1
    trials = study.section("beyond")["data"]["trials"]
    for hysteresis in ("bouc_wen", "relays"):
        for scheme in SCHEMES:
            found = study.summary["beyond"][hysteresis][scheme]
            assert list(found) == ["hz_0_5", "hz_2", "hz_5"]
            for frequency_hz, values in zip((0.5, 2.0, 5.0), found.values(), strict=True):
                for prepared in ("", "dry_run", "learned"):
                    before = f"{prepared}_" if prepared else ""
                    shown = [
                        trial
                        for trial in trials
                        if (trial["hysteresis"], trial["scheme"], trial["frequency_hz"])
                        == (hysteresis, scheme, frequency_hz)
                        and trial["prepared"] == prepared
                    ]
                    if prepared == "dry_run" and not shown:  # its table would not have helped
                        assert not any(name.startswith(before) for name in values)
                        continue
                    (one,) = shown
                    for quantity in ("position_percent", "force_percent"):
                        # Median and worst value of one rig are equal.
                        assert values[before + quantity] == one[quantity]
                        assert values[f"{before}{quantity}_worst"] == one[quantity]
            # For this rig the law is limited by the noise of the sensor; the paper has 6 to 8 %.
            assert found["hz_0_5"]["position_percent"] < 1.0
            assert found["hz_0_5"]["force_percent"] < 2.0
            assert found["hz_2"]["position_percent"] < 1.5
            assert found["hz_5"]["learned_position_percent"] < 1.2


def test_the_duration_of_grips_is_reported(study: Study) -> None:
    quick, gentle = (study.summary["grip"][profile] for profile in ("quick", "gentle"))
    assert quick["seconds_without_hold"] < 3.5 < gentle["seconds_without_hold"]
    for found in (quick, gentle):
        assert found["seconds_without_hold"] <= found["seconds_without_hold_worst"]
        assert 0.95 < found["peak_over_planned"] <= found["peak_over_planned_worst"] < 1.15
        assert 0.0 < found["hold_error_percent"] <= found["hold_error_percent_worst"] < 6.0


def test_the_study_contains_paths_and_grips_at_1_khz(study: Study) -> None:
    found = study.summary["beyond"]["kilohertz"]
    assert set(found) == {"relays", "grip"}
    path = found["relays"]["fpbsmic"]["hz_10"]
    for prepared in ("", "dry_run_", "missed_1_"):
        assert path[f"{prepared}position_percent"] < 1.5
        assert path[f"{prepared}force_percent"] < 3.0
    for grip in ("quick", "dry_run"):
        assert found["grip"][grip]["seconds_without_hold"] <= 1.5
        assert found["grip"][grip]["peak_over_planned"] < 1.05


def test_the_estimator_is_reported_with_its_signals(study: Study) -> None:
    by_signal = study.summary["estimator_free_rmse_mN_by_signal"]
    assert study.summary["estimator_free_rmse_mN"] == by_signal["sinusoid 0.5 Hz"]
    assert len(by_signal) > 1
    # Far below the error with a straight line for x_1, which is at least 2 mN at such strokes.
    assert all(0.0 < rmse_mN < 1.5 for rmse_mN in by_signal.values())


def test_on_the_stability_map_the_papers_period_is_stable_and_1_ms_is_not(study: Study) -> None:
    data = study.section("stability")["data"]
    paper, fast = data["periods_s"].index(0.02), data["periods_s"].index(0.001)
    for scheme in ("PBSMIC", "DSMIFC"):
        radius = data["radius"][scheme]
        assert radius[paper][data["K_P"].index(1.0)] < 0.97
        assert radius[fast][data["K_P"].index(1.0)] > 1.0
