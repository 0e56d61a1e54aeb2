"""Table of the free response: that of the demo rig is the one in its rig file."""

import tomllib
from math import pi, sin
from pathlib import Path

import numpy as np
import pytest

from pincette.config import ConfigError, RigFile, parse_rig, read_rig
from pincette.config.derived import free_response
from pincette.control.response.hysteresis_motion import simulate
from pincette.control.response.identification import Identification
from pincette.control.response.recorded_response import RecordedResponse
from pincette.control.response.recording import Recording
from pincette.core.messages import GroundTruth
from pincette.engine import teaching
from pincette.engine.response_table import as_toml, response_tables
from pincette.engine.teaching import record, teach
from pincette.sim.rig.rig import SimulatedRig
from pincette_study.beyond.tracks import CLASSES, REACH_UM
from tests.support.two_arms import TWO_ARMS

DEMO = Path(__file__).parents[3] / "deploy/rigs/demo.toml"
TOLERANCE_UM = 0.02
"""Of displacement, over two strokes: rounding of the table and of the linear algebra."""


def test_identification_of_the_demo_rig_reproduces_the_committed_response_table() -> None:
    rig = read_rig(DEMO)
    committed = rig.model.free_response
    assert committed is not None, f"{DEMO} has no [model.free_response]"
    found = teach(rig)
    voltage_V = np.concatenate([np.linspace(0, 2.4, 200), np.linspace(2.4, -0.4, 200)] * 2)
    difference = simulate(found.model, voltage_V, 0.02) - simulate(
        committed.hysteresis(), voltage_V, 0.02
    )
    worst_um = float(np.max(np.abs(difference)))
    assert worst_um < TOLERANCE_UM, f"{DEMO} is out of date: replace its table by\n{as_toml(found)}"
    assert committed.residual_um == pytest.approx(found.residual_um, abs=0.002)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_sinusoid_that_was_not_taught_is_followed(seed: int) -> None:
    """The paper's error without contact, 0.26 mN r.m.s., on 2 V peak to peak at 0.5 Hz."""
    rig = read_rig(DEMO)
    taught = rig.model.free_response
    assert rig.simulation is not None
    assert taught is not None
    positions_um: list[float] = []
    free = rig.simulation.model_copy(update={"bead": False, "seed": seed})

    def hear(truth: GroundTruth) -> None:
        positions_um.append(truth.arms[0].x_um)

    plant = SimulatedRig(free, 0.02, True, lambda: 0.0, hear)
    rise = [0.02 * k for k in range(50)] + [1.0] * 50
    sinusoid = [1.0 + sin(2.0 * pi * 0.5 * 0.02 * k) for k in range(1000)]
    voltages_V = [*rise, *sinusoid]
    for voltage_V in voltages_V:
        plant.put_out(voltage_V)
    # x_k follows the voltage of k-1.
    x_um = np.array(positions_um[1:])
    x_1_um = simulate(taught.hysteresis(), np.array(voltages_V[:-1]), 0.02)
    error_um = float(np.std((x_um - x_1_um)[len(rise) :]))
    assert error_um / rig.model.compliance_um_per_mN < 0.26


def test_the_printed_table_fits_into_a_rig_file() -> None:
    committed = read_rig(DEMO).model.free_response
    assert committed is not None
    text = as_toml(Identification(committed.hysteresis(), committed.residual_um))
    tables = tomllib.loads(DEMO.read_text(encoding="utf-8"))
    tables["model"]["free_response"] = tomllib.loads(text)["model"]["free_response"]
    assert parse_rig(tables).model.free_response == committed


def test_a_rig_that_is_not_simulated_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "hardware.toml"
    text = DEMO.read_text(encoding="utf-8")
    path.write_text(text[: text.index("[simulation]")], encoding="utf-8")
    with pytest.raises(ConfigError, match="pincette job calibrate free_response"):
        response_tables(path, "identified")


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"weights_um_per_V": [1.0]}, "1 weights_um_per_V, must be 3"),
        ({"thresholds_V": [0.0, 0.3, 0.0]}, "threshold = 0.0 V"),
        ({"thresholds_V": [0.0, 0.3, 0.3]}, "0.3 V with fading 1.0 per V occurs twice"),
        ({"creep_fractions": [0.1]}, "1 creep_fractions, must be 2"),
        ({"fadings_per_V": [0.0, 1.0]}, "2 fadings_per_V, must be 3"),
        ({"return_fadings_per_V": [0.0, 1.0]}, "2 return_fadings_per_V, must be 3"),
        ({"residual_um": -0.1}, "residual_um"),
    ],
)
def test_impossible_tables_are_refused(change: dict[str, object], text: str) -> None:
    tables = tomllib.loads(DEMO.read_text(encoding="utf-8"))
    tables["model"]["free_response"] = {
        "thresholds_V": [0.0, 0.3, 0.6],
        "weights_um_per_V": [16.0, 2.0, 1.0],
        "creep_times_s": [1.0, 10.0],
        "creep_fractions": [0.01, 0.02],
        "fadings_per_V": [0.0, 1.0, 1.0],
        "residual_um": 0.1,
    }
    parse_rig(tables)
    tables["model"]["free_response"] |= change
    with pytest.raises(ConfigError, match=text):
        parse_rig(tables)


def test_a_motion_that_ends_early_is_refused_for_identification() -> None:
    rig = read_rig(DEMO)
    tight = rig.model_copy(update={"limits": rig.limits.model_copy(update={"force_max_mN": 1.0})})
    with pytest.raises(ValueError, match=r"ended as 'overforce' after \d+ samples"):
        teach(tight)


def test_an_arm_with_an_unknown_past_is_not_identified_as_unpoled() -> None:
    """Relays have random states when the arm is switched on; a pair calibrated in this state had
    errors of 20 %."""
    drawn, _ = CLASSES["relays"](read_rig(TWO_ARMS).arms[0], 501)
    low_um, high_um = REACH_UM
    limits = drawn.limits.model_copy(update={"position_min_um": low_um, "position_max_um": high_um})
    drawn = drawn.model_copy(update={"limits": limits})
    words = r"limit .* 0\.5 % of the range.*calibrate free_response.*--arm 2"
    with pytest.raises(ValueError, match=words):
        teach(drawn, to_limits=True)


def test_recorded_branches_replace_the_identified_response(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    recording, requested = record(read_rig(DEMO)), list[RigFile]()

    def recorded(rig: RigFile, *, to_limits: bool) -> Recording:
        assert not to_limits
        requested.append(rig)
        return recording

    monkeypatch.setattr(teaching, "record", recorded)
    tables = tomllib.loads(DEMO.read_text(encoding="utf-8"))
    tables["model"]["recorded_response"] = tomllib.loads(response_tables(DEMO, "recorded"))[
        "model"
    ]["recorded_response"]
    assert requested == [read_rig(DEMO)]
    with pytest.raises(ConfigError, match="are both given"):
        parse_rig(tables)
    del tables["model"]["free_response"]
    rig = parse_rig(tables)
    response = free_response(rig.model)
    assert isinstance(response, RecordedResponse)
    assert response.branches.top == pytest.approx(recording.branches.top, abs=1e-3)
    assert response.branches.ascending == pytest.approx(recording.branches.ascending, abs=1e-5)
    assert response.model_error_um == pytest.approx(recording.residual_um, abs=5e-4)
    # The branches up and down over the stroke differ: there is a loop.
    middle_um: list[float] = []
    for end_V in (3.0, 0.0):
        for step in range(51):
            response = response.updated(1.5 + (end_V - 1.5) * step / 50, 0.02)
        for step in range(51):
            response = response.updated(end_V + (1.5 - end_V) * step / 50, 0.02)
        middle_um.append(response.displacement_um())
    assert middle_um[0] - middle_um[1] > 2.0


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"top_V": -9.0}, "voltage of the stroke"),
        ({"descending": [0.0, 0.6, 0.5, 1.0]}, "rise of the descending shape"),
        ({"residual_um": -0.1}, "residual_um"),
    ],
)
def test_impossible_branches_are_refused(change: dict[str, object], text: str) -> None:
    tables = tomllib.loads(DEMO.read_text(encoding="utf-8"))
    del tables["model"]["free_response"]
    tables["model"]["recorded_response"] = {
        "bottom_V": 0.0,
        "bottom_um": 0.0,
        "top_V": 3.0,
        "top_um": 57.0,
        "ascending": [0.0, 0.4, 1.0],
        "descending": [0.0, 0.4, 1.0],
        "residual_um": 0.4,
    }
    parse_rig(tables)
    tables["model"]["recorded_response"] |= change
    with pytest.raises(ConfigError, match=text):
        parse_rig(tables)
