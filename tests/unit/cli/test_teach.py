"""``pincette teach``: what it finds for the demo rig is what the rig file carries."""

import tomllib
from math import pi, sin
from pathlib import Path

import numpy as np
import pytest

from pincette.cli.main import main
from pincette.cli.teach import as_toml, free_range_um, identify
from pincette.config import ConfigError, parse_rig, read_rig
from pincette.control.hysteresis_motion import simulate
from pincette.control.identification import Identification
from pincette.sim.rig import SimulatedRig

DEMO = Path(__file__).parents[3] / "deploy/rigs/demo.toml"
NARROW = (0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
TOLERANCE_UM = 0.02
"""Of displacement, over two strokes: rounding of the table and of the linear algebra."""


def test_the_committed_table_is_what_teaching_finds() -> None:
    rig = read_rig(DEMO)
    committed = rig.model.free_response
    assert committed is not None, f"{DEMO} has no [model.free_response]: run `pincette teach`"
    found = identify(rig)
    voltage_V = np.concatenate([np.linspace(0, 2.4, 200), np.linspace(2.4, -0.4, 200)] * 2)
    difference = simulate(found.model, voltage_V, 0.02) - simulate(
        committed.hysteresis(), voltage_V, 0.02
    )
    worst_um = float(np.max(np.abs(difference)))
    assert worst_um < TOLERANCE_UM, f"{DEMO} is stale: put in its place\n{as_toml(found)}"
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
    plant = SimulatedRig(
        free, 0.02, True, lambda: 0.0, lambda _seq, x_um, _F, _u: positions_um.append(x_um)
    )
    rise = [0.02 * k for k in range(50)] + [1.0] * 50
    sinusoid = [1.0 + sin(2.0 * pi * 0.5 * 0.02 * k) for k in range(1000)]
    voltages_V = [*rise, *sinusoid]
    for voltage_V in voltages_V:
        plant.put_out(voltage_V)
    # x_k answers to the voltage of k-1.
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


def test_the_motion_covers_the_softest_part_and_stays_within_the_limits() -> None:
    rig = read_rig(DEMO)
    low_um, high_um = free_range_um(rig)
    assert high_um == pytest.approx(33.0 + 20.0 / (0.7 * 2.17) + 0.46 * 20.0)
    assert low_um == pytest.approx(-0.1 * high_um)
    tight = rig.model_copy(
        update={
            "limits": rig.limits.model_copy(
                update={"position_min_um": -1.0, "position_max_um": 40.0}
            )
        }
    )
    assert free_range_um(tight) == (-1.0, 40.0)


def test_a_rig_that_is_not_simulated_is_told_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "hardware.toml"
    text = DEMO.read_text(encoding="utf-8")
    path.write_text(text[: text.index("[simulation]")], encoding="utf-8")
    assert main(["teach", "--rig", str(path)]) == 1
    assert "comes with calibration" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"weights_um_per_V": [1.0]}, "1 weights_um_per_V, must be 10"),
        ({"thresholds_V": [0.0, 0.3, 0.2, *NARROW]}, "must be above 0.3 V"),
        ({"creep_fractions": [0.1]}, "1 creep_fractions, must be 4"),
        ({"fading_per_V": 2.0}, "1/fading"),
        ({"residual_um": -0.1}, "residual_um"),
    ],
)
def test_impossible_tables_are_refused(change: dict[str, object], text: str) -> None:
    tables = tomllib.loads(DEMO.read_text(encoding="utf-8"))
    tables["model"]["free_response"] |= change
    with pytest.raises(ConfigError, match=text):
        parse_rig(tables)
