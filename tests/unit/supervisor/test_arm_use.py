"""Strokes, contacts and hours since the last calibration, and the alarm that a limit raises."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pincette.config import RigFile, parse_rig
from pincette_supervisor.results.arm_use import contacts, strokes

from .harness import Harness


def limited(rig: RigFile, **limits: float) -> RigFile:
    """Return the rig with limits of the use since a calibration."""
    return parse_rig(rig.model_dump(exclude_unset=True) | {"calibration": limits})


def due(harness: Harness) -> list[dict[str, Any]]:
    harness.manager.alarm_monitor.poll()
    listed: list[dict[str, Any]] = harness.get("/alarms", open="true")["alarms"]
    return [one for one in listed if one["cause"] == "calibration.due"]


@pytest.mark.parametrize("cycles", [0, 1, 7])
def test_each_cycle_of_a_noisy_motion_is_one_stroke(cycles: int) -> None:
    phase = np.linspace(0.0, 2.0 * np.pi * cycles, 1000)
    noise = np.random.default_rng(1).normal(0.0, 0.2, 1000)
    x_um = (-10.0 * np.cos(phase) + noise).tolist()
    assert strokes([None, *x_um, None], stroke_um=4.5) == cycles


def test_motions_below_the_smallest_stroke_do_not_count_unless_they_add_up() -> None:
    assert strokes([0.0, 4.0, 0.0, 4.0, 0.0], stroke_um=4.5) == 0
    assert strokes([0.0, 4.0, 3.0, 7.0, 6.0, 10.0], stroke_um=4.5) == 1
    # A return towards rest, such as that of a release, is no stroke.
    assert strokes([40.0, 30.0, 20.0, 10.0], stroke_um=4.5) == 0


def test_a_contact_counts_where_the_arm_begins_to_press() -> None:
    phases = ["approach", "contact", "load", "hold", "unload", "retreat", "contact", "load"]
    assert contacts(phases, [None, 31.0, 31.2, 31.1, 31.1, 31.1, 30.9, 30.9]) == 2
    # A job that begins with a held part meets no part.
    assert contacts(["hold", "hold", "unload"], [31.0, 31.0, 31.0]) == 0
    # The free grips of a calibration load without a part.
    assert contacts(["approach", "load", "hold"], [None, None, None]) == 0


@pytest.mark.usefixtures("drawn")
def test_the_counters_survive_a_restart_and_begin_again_with_a_calibration(
    rig_file: RigFile, tmp_path: Path
) -> None:
    harness = Harness(limited(rig_file, valid_contacts=2), tmp_path)
    try:
        assert harness.get("/rigs/demo")["use"] == {
            "since": None, "strokes": 0, "contacts": 0, "hours": 0.0, "due": [],
        }  # fmt: skip
        job = harness.ended(harness.grip()["id"])
        one = harness.get("/rigs/demo")["use"]
        assert one["contacts"] == job["result"]["use"]["contacts"] == 1
        assert one["strokes"] == job["result"]["use"]["strokes"] >= 1
        assert 3600.0 * one["hours"] == pytest.approx(job["result"]["use"]["duration_s"])
        assert due(harness) == []
        harness.ended(harness.grip()["id"])
        two = harness.get("/rigs/demo")["use"]
        assert two["due"] == ["contacts"]
        assert (two["strokes"], two["contacts"]) == (2 * one["strokes"], 2)
        (alarm,) = due(harness)
        assert (alarm["severity"], alarm["clears"]) == ("warning", "condition")
        checks = {check["name"]: check for check in harness.get("/rigs/demo")["checks"]}
        assert not checks["calibration.use"]["ok"]
        assert not checks["calibration.use"]["needed"]
    finally:
        harness.close()
    harness = Harness(limited(rig_file, valid_contacts=2), tmp_path)
    try:
        assert harness.get("/rigs/demo")["use"] == two
        model = harness.manager.context.model
        model.add({"sensor.noise_um": 0.04}, {}, "a")
        begun = harness.get("/rigs/demo")["use"]
        assert begun["since"] is not None
        assert (begun["contacts"], begun["due"]) == (0, [])
        harness.manager.alarm_monitor.poll()
        assert all(one["cleared_at"] for one in due(harness))
        # Without the calibration, every job counts.
        model.use(0)
        assert harness.get("/rigs/demo")["use"]["contacts"] == 2
    finally:
        harness.close()


def test_an_expired_calibration_raises_the_alarm(harness: Harness) -> None:
    model = harness.manager.context.model
    assert due(harness) == []
    days = model.file.calibration.model_copy(update={"valid_days": 1e-9})
    model.file = model.file.model_copy(update={"calibration": days})
    model.add({"sensor.noise_um": 0.04}, {}, "a", "2000-01-01T00:00:00.000Z")
    assert len(due(harness)) == 1
    assert harness.get("/rigs/demo")["use"]["due"] == ["days"]
