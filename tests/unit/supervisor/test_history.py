"""Hours of history: smallest and largest values of the records, and nothing between them."""

from typing import Any

import numpy as np
import pyarrow.parquet as untyped_parquet
import pytest

from pincette_supervisor.plugin.figures import Series
from pincette_supervisor.results import history

from .harness import Harness


def record(seconds: int, period_s: float = 0.02) -> dict[str, Series]:
    """A ramp of the position with one peak, and a force that is known from 1 s on."""
    t_s = period_s * np.arange(float(round(seconds / period_s)))
    x_um = t_s.copy()
    x_um[10] = 50.0
    zeroed = np.where(t_s < 1.0, np.nan, 0.0)
    flat = np.zeros(t_s.size)
    return {
        "t_s": t_s,
        "x_um": x_um,
        "x_r_um": t_s,
        "force_mN": flat + 3.0,
        "force_r_mN": flat + 2.0,
        "zero_age_s": zeroed,
        "voltage_V": flat,
        "sliding_um": flat,
    }


def test_a_peak_of_one_sample_is_kept() -> None:
    at_s, low, high = history.reduce(record(4), 1000.0, None)
    assert at_s.tolist() == [1000.5, 1001.5, 1002.5, 1003.5]
    assert high[history.NAMES.index("x_um")][0] == 50.0
    assert high[history.NAMES.index("x_error_um")][0] == pytest.approx(49.8)
    assert low[history.NAMES.index("x_um")].tolist() == pytest.approx([0.0, 1.0, 2.0, 3.0])


def test_a_force_without_a_zero_is_omitted() -> None:
    _, low, _ = history.reduce(record(2), 1000.0, None)
    assert np.isnan(low[history.NAMES.index("force_mN")][0])
    assert low[history.NAMES.index("force_error_mN")][1] == 1.0


def test_times_of_samples_in_lockstep_are_spread_over_the_duration_of_the_job() -> None:
    at_s, _, _ = history.reduce(record(4), 1000.0, 7.9)
    assert at_s[-1] == 1007.5


def test_the_current_second_is_shown() -> None:
    reduced = history.reduce(record(4), 1000.0, None)
    at_s, _, _ = history.joined([reduced], 900.0, 1003.2, 1.0)
    assert at_s.tolist() == [1000.5, 1001.5, 1002.5, 1003.5]


def test_hours_are_read_over_rest_up_to_the_requested_end(harness: Harness) -> None:
    job = harness.ended(harness.grip()["id"])
    name = harness.manager.name
    found = harness.get(f"/rigs/{name}/history", hours=2, points=50)
    assert [(each["id"], each["recorded"]) for each in found["jobs"]] == [(job["id"], True)]
    assert found["step_s"] >= 7200.0 / 50.0
    assert len(found["at_s"]) == len(found["low"]["x_um"]) == len(found["high"]["force_mN"]) > 0
    peak = max(value for value in found["high"]["force_mN"] if value is not None)
    assert peak == pytest.approx(job["result"]["force_held_mN"], abs=1.0)
    before = harness.get(f"/rigs/{name}/history", hours=1, to_s=found["from_s"])
    assert (before["jobs"], before["at_s"]) == ([], [])


@pytest.mark.parametrize("points", [50, 2000])
def test_the_samples_of_a_job_cover_its_own_duration(harness: Harness, points: int) -> None:
    job = harness.ended(harness.grip()["id"])
    name = harness.manager.name
    found = harness.get(f"/rigs/{name}/history", job=job["id"], points=points)
    assert [(each["id"], each["recorded"]) for each in found["jobs"]] == [(job["id"], True)]
    begun_s = history.seconds(job["started_at"])
    assert found["from_s"] == begun_s
    spent_s = found["at_s"][-1] - begun_s
    last = job["result"]["phases"][-1]
    assert spent_s == pytest.approx(last["start_s"] + last["duration_s"], rel=0.05)
    assert 40 < len(found["at_s"]) <= points + 1
    peak = max(value for value in found["high"]["force_mN"] if value is not None)
    assert peak >= job["result"]["force_held_mN"]


def test_the_second_arm_has_columns_where_the_record_has_it() -> None:
    pair = record(2)
    for name in history.SECOND:
        pair[name] = pair["voltage_V"] + 5.0
    pair["second_zero_age_s"] = pair["zero_age_s"]
    _, low, high = history.reduce(pair, 1000.0, None)
    forces = low[history.NAMES.index("second_force_mN")]
    assert np.isnan(forces[0])
    assert forces[1] == 5.0
    assert high[history.NAMES.index("second_x_um")].tolist() == [5.0, 5.0]
    assert high[history.NAMES.index("second_voltage_V")].tolist() == [5.0, 5.0]


def test_a_record_of_one_arm_has_no_columns_of_a_second(harness: Harness) -> None:
    job = harness.ended(harness.grip()["id"])
    found = harness.get(f"/rigs/{harness.manager.name}/history", job=job["id"])
    assert not [name for name in found["low"] if name.startswith("second_")]


def test_a_record_of_two_arms_is_read_with_the_columns_of_both(harness: Harness) -> None:
    job = harness.ended(harness.grip()["id"])
    path = harness.bus.records / job["id"] / "samples.parquet"
    parquet: Any = untyped_parquet
    table = parquet.read_table(path)
    for name in (*history.SECOND, "second_zero_age_s"):
        table = table.append_column(name, table[name.removeprefix("second_")])
    parquet.write_table(table, path)
    found = harness.get(f"/rigs/{harness.manager.name}/history", job=job["id"], points=500)
    for side in ("low", "high"):
        for name in history.SECOND:
            assert found[side][name] == found[side][name.removeprefix("second_")]


def test_a_deleted_record_leaves_its_job_without_samples(harness: Harness) -> None:
    job = harness.ended(harness.grip()["id"])
    (harness.bus.records / job["id"] / "samples.parquet").unlink()
    queries: tuple[dict[str, str], ...] = ({}, {"job": job["id"]})
    for query in queries:
        found = harness.get(f"/rigs/{harness.manager.name}/history", **query)
        assert [each["recorded"] for each in found["jobs"]] == [False]
        assert found["at_s"] == []
