"""A part that slips and a sensor that jumps, on the simulated demo rig in one process."""

import pytest

from pincette.records.columns import columns
from pincette_supervisor.plugin.result import position_step_of, with_ring
from tests.support.rigs import Tree
from tests.support.slips import Played, played

PLANNED_MN = 20.0


def gives_way(slip_um: float, slips: int = 1) -> Tree:
    return {"part": {"slip_force_mN": 12.0, "slip_um": slip_um, "slips": slips}, "seed": 7}


def in_the_hold(target: str, what: str, value: float) -> Tree:
    order = {"at_s": 3.5, "target": target, "what": what, "value": value}
    return {"script": [order], "seed": 7}


def stays_within_the_plan(job: Played) -> bool:
    """Check that force, references and voltage stay within the limits of the plan; the voltage
    was 3.98 V."""
    planned = job.planned.program.planned_range
    assert planned is not None
    assert planned.position_max_um is not None
    assert planned.position_max_um < 52.0
    assert planned.voltages[0].max_V < 3.4
    reached_V = max(applied.arms[0].voltage_V for applied in job.applied)
    reached_um = max(view.arms[0].x_r_um for view in job.views)
    print(f"peak {job.peak_mN:.2f} mN, {reached_V:.2f} of {planned.voltages[0].max_V:.2f} V")
    assert reached_um <= planned.position_max_um
    assert max(view.force_r_mN for view in job.views if view.phase == "load") <= 1.05 * PLANNED_MN
    return job.peak_mN < 1.1 * PLANNED_MN and reached_V <= planned.voltages[0].max_V


@pytest.mark.parametrize(("profile", "slip_um"), [("quick", 3.0), ("gentle", 10.0)])
def test_a_slipping_part_is_released(profile: str, slip_um: float) -> None:
    job = played(gives_way(slip_um), profile=profile)
    assert job.outcome == "slipped"
    assert job.phases[-3:] == ["load", "unload", "retreat"]
    assert stays_within_the_plan(job)
    assert job.peak_mN < 13.0
    assert job.truths[max(job.truths)].arms[0].force_mN == 0.0
    found = position_step_of(columns(job.messages, 0.02))
    assert found is not None
    assert found.slips == 1
    assert found.cause != "sensor"
    assert found.force_mN == pytest.approx(12.0, abs=1.5)
    assert found.slip_um == pytest.approx(slip_um, rel=0.25)


@pytest.mark.parametrize(
    ("order", "outcome", "cause", "true_mN"),
    [
        (("sensor", "wrong", 2.0), "position_step", "sensor", 20.2),
        (("sensor", "wrong", -2.0), "sensor_jump", "sensor", 20.2),
        (("part", "slip", 4.2), "position_step", "slip", 15.7),
    ],
)
def test_a_step_in_a_hold_freezes_the_voltage(
    order: tuple[str, str, float], outcome: str, cause: str, true_mN: float
) -> None:
    job = played(in_the_hold(*order), hold_s=3.0)
    assert job.outcome == outcome
    later = [
        job.truths[view.seq].arms[0].force_mN
        for view in job.views
        if view.phase == "hold" and view.step_um is not None
    ]
    assert len(later) > 20
    assert min(later[3:]) == pytest.approx(true_mN, abs=0.5)
    assert max(later[3:]) == pytest.approx(true_mN, abs=0.5)
    assert stays_within_the_plan(job)
    table = columns(job.messages, 0.02)
    found = position_step_of(table)
    assert found is not None
    assert found.cause == cause
    assert with_ring(found, table, job.rig).rang is (cause == "slip")
    readings = [found.force_if_slip_mN, found.force_if_sensor_mN]
    assert any(reading == pytest.approx(true_mN, abs=0.7) for reading in readings)
    assert job.truths[max(job.truths)].arms[0].force_mN == 0.0


@pytest.mark.parametrize(
    "order",
    [
        ("sensor", "wrong", 2.0),
        ("sensor", "wrong", -2.0),
        ("part", "slip", 4.2),
    ],
)
def test_the_uncertainty_covers_both_readings_from_a_step_to_the_end(
    order: tuple[str, str, float],
) -> None:
    job = played(in_the_hold(*order), hold_s=3.0)
    step = next(view for view in job.views if view.step_um is not None)
    doubted = {seq: one.arms[0] for seq, one in job.estimates.items() if seq > step.seq + 2}
    free = [seq for seq in doubted if job.truths[seq].arms[0].force_mN == 0.0]
    assert len(free) > 20
    for seq, one in doubted.items():
        error_mN = abs(one.force_mN - job.truths[seq].arms[0].force_mN)
        assert error_mN <= one.force_uncertainty_mN, f"{seq}: {error_mN} mN"
        assert one.force_doubt_mN == pytest.approx(4.4, abs=0.6)
        assert one.force_uncertainty_mN - one.force_doubt_mN < 1.0
    before = [one.arms[0].force_doubt_mN for seq, one in job.estimates.items() if seq < step.seq]
    assert max(before) == 0.0


FAST: Tree = {
    "limits": {"slew_V_per_s": 60.0},
    "track": {"rate_um_per_s": 600.0, "acceleration_um_per_s2": 8000.0},
}
"""Limits that allow a path of 5 Hz."""


def along_path(hz: float, simulation: Tree | None = None) -> Played:
    """Track a sinusoid with an output without lag, which excites the mode most."""
    wishes = {"shape": "sinusoid", "frequency_hz": hz, "cycles": 6, "force_pp_mN": 16.0}
    without_lag = {"output_lag_s": 0.0, **(simulation or {})}
    return played(without_lag, FAST, kind="track", **wishes)


@pytest.mark.parametrize("hz", [0.5, 5.0])
def test_a_healthy_path_is_not_stopped(hz: float) -> None:
    job = along_path(hz)
    assert job.outcome == "tracked"
    assert job.views[-1].step_um is None


@pytest.mark.parametrize(
    ("hz", "order", "outcome"),
    [
        (0.5, ("part", "slip", 3.0), "slipped"),
        (2.0, ("sensor", "wrong", -2.0), "sensor_jump"),
    ],
)
def test_a_position_step_along_a_path_ends_the_path(
    hz: float, order: tuple[str, str, float], outcome: str
) -> None:
    target, what, value = order
    healthy = along_path(hz).views
    # The crest of a later cycle, in the time of the script, which begins with the first write.
    at_s = next(
        index * 0.02
        for index, view in enumerate(healthy)
        if view.phase == "track" and view.segment_tick > 30 and view.force_r_mN > 19.0
    )
    script = {"at_s": at_s, "target": target, "what": what, "value": value}
    job = along_path(hz, {"script": [script]})
    assert job.outcome == outcome
    assert job.views[-1].step_um is not None
    assert job.peak_mN < 1.1 * 24.0
    assert job.truths[max(job.truths)].arms[0].force_mN == 0.0
