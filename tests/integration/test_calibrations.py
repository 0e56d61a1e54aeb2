"""Calibrations played by the whole loop on a simulated rig; their proposals are compared with
the truth."""

from collections.abc import Generator
from functools import partial

import pytest

from pincette.config import Calibration, RigFile, derived, read_rig
from pincette.config import calibrated as calibrated_rig
from pincette.config.reading import laid_over
from pincette.control.arm.shaping import shaping_interval_s
from pincette.sim.bench import Bench
from pincette_controller.config import configure
from pincette_supervisor.results.archive import Record
from tests.support.calibrating import Bystander, calibrated, opened_benches, result_of, value
from tests.support.rigs import DEMO, Tree, at_own_ports, demo_rig

WITHIN = 0.02
"""Largest deviation from the truth."""
AWAY: Tree = {"simulation": {"bead": False}}


@pytest.fixture
def bench() -> Generator[list[Bench]]:
    with opened_benches() as opened:
        yield opened


played = partial(demo_rig, AWAY, time="lockstep")


def test_the_noise_is_that_of_the_sensor(bench: list[Bench]) -> None:
    rig = played()
    assert rig.simulation is not None
    record, _ = calibrated(rig, bench, "noise")
    simulated = rig.simulation
    # A step of q adds q²/12 to the variance of the readings.
    true_um = (simulated.sensor_noise_um**2 + simulated.sensor_step_um**2 / 12.0) ** 0.5
    assert value(record, "sensor.noise_um") == pytest.approx(true_um, rel=0.1)
    figures = {figure.name: figure.value for figure in result_of(record).figures}
    # The display rounds multiples of the step to 0.01 µm.
    assert figures["step"] == pytest.approx(simulated.sensor_step_um, abs=0.0051)


@pytest.mark.parametrize(("slope_um_per_s", "stated", "least"), [(0.02, 0.0, 1.2), (0.0, 3.0, 3.0)])
def test_the_drift_at_rest_is_proposed_and_never_below_that_of_the_rig_file(
    bench: list[Bench], slope_um_per_s: float, stated: float, least: float
) -> None:
    drifting: Tree = {
        "simulation": {"bead": False, "drift": {"slope_um_per_s": slope_um_per_s}},
        "sensor": {"drift_um_per_min": stated},
    }
    record, _ = calibrated(demo_rig(drifting, time="lockstep"), bench, "noise")
    found = value(record, "sensor.drift_um_per_min")
    assert found == pytest.approx(least, abs=0.08)
    assert found >= least - 0.04


def test_weights_hung_as_requested_give_the_compliance(bench: list[Bench]) -> None:
    rig = played()
    assert rig.simulation is not None
    weights = [0.0, 5.0, 10.0, 20.0]
    record, person = calibrated(rig, bench, "compliance", weights_mN=weights)
    assert person.hung == [0.0, 5.0, 10.0, 20.0, 10.0, 5.0, 0.0]
    found = value(record, "model.compliance_um_per_mN")
    assert found == pytest.approx(rig.simulation.compliance_um_per_mN, rel=WITHIN)
    (item,) = result_of(record).values
    assert item.uncertainty is not None
    assert 0.0 < item.uncertainty < WITHIN * found


def test_weights_that_were_not_hung_give_no_compliance(
    bench: list[Bench], monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = played()

    def forget(_person: Bystander, _weight_mN: float) -> None:
        return

    monkeypatch.setattr(Bystander, "hang", forget)
    record, _ = calibrated(rig, bench, "compliance", "were the weights hung")
    assert result_of(record).values == []


def test_the_free_response_has_the_secant_gain_of_the_rig(bench: list[Bench]) -> None:
    rig = played()
    record, _ = calibrated(rig, bench, "free_response")
    # The demo rig is set to the paper's 19.0 µm/V at 2 V peak to peak.
    assert value(record, "model.piezo_um_per_V") == pytest.approx(19.0, rel=WITHIN)
    taught = value(record, "model.free_response")
    assert taught["residual_um"] < 0.3
    figures = {figure.name: figure.value for figure in result_of(record).figures}
    assert figures["loop"] == pytest.approx(18.5, abs=1.5)


def test_a_press_finds_stiffness_and_place_of_the_contact(bench: list[Bench]) -> None:
    rig = demo_rig(time="lockstep")
    assert rig.simulation is not None
    record, _ = calibrated(rig, bench, "contact_stiffness")
    simulated = rig.simulation
    assert value(record, "part.stiffness_mN_per_um") == pytest.approx(
        simulated.environment_stiffness_mN_per_um, rel=WITHIN
    )
    assert value(record, "part.contact_um") == pytest.approx(simulated.bead_contact_um, abs=0.3)
    (sure,) = [v for v in result_of(record).values if v.quantity == "part.contact_um"]
    # A kink in the model's error looks like a kink of the arm; only a few tenths of a volt are
    # examined.
    response = derived.free_response(rig.model).begin(0.0).updated(0.3, 0.0)
    assert sure.uncertainty is not None
    assert response.error_um() < sure.uncertainty < 0.3
    assert result_of(record).warnings == [
        f"depends on {quantity}, which is assumed: calibrate it first"
        for quantity in ("model.compliance_um_per_mN", "model.free_response")
    ]


def swept(bench: list[Bench], changes: Tree) -> tuple[RigFile, Record]:
    own = laid_over({"rig": {"time": "lockstep"}, **AWAY}, changes)
    rig = at_own_ports(read_rig(DEMO.parent / "fast.toml"), own)
    assert rig.simulation is not None
    record, _ = calibrated(rig, bench, "frequency_response", duration_s=10.0)
    simulated = rig.simulation
    omega_n = value(record, "model.natural_frequency_rad_per_s")
    assert omega_n == pytest.approx(simulated.natural_frequency_rad_per_s, rel=0.002)
    zeta = value(record, "model.damping_ratio")
    assert zeta == pytest.approx(simulated.damping_ratio, rel=0.05)
    return rig, record


def test_a_buffered_sweep_with_the_fast_instruments_finds_the_mode(bench: list[Bench]) -> None:
    swept(bench, {})


def test_a_sweep_determines_the_shaping_interval(bench: list[Bench]) -> None:
    """The sweep itself has no parts."""
    rig, record = swept(bench, {"output": {"shaping": True}})
    omega_n = value(record, "model.natural_frequency_rad_per_s")
    loaded = calibrated_rig(
        rig, Calibration(values={"model.natural_frequency_rad_per_s": omega_n}, sources={})
    )
    ratio = rig.model.compliance_um_per_mN * rig.part.stiffness_mN_per_um
    assert loaded.shaping_s == pytest.approx(shaping_interval_s(omega_n, ratio))
    (shown,) = [one for one in result_of(record).figures if one.name == "shaping interval"]
    assert 1e-3 * shown.value == pytest.approx(loaded.shaping_s)


def test_bursts_at_1_khz_find_the_output_delay_and_the_mode(bench: list[Bench]) -> None:
    rig = at_own_ports(read_rig(DEMO.parent / "kilohertz.toml"), AWAY)
    record, _ = calibrated(rig, bench, "output_timing")
    simulated = rig.simulation
    assert simulated is not None
    truth = {
        "model.natural_frequency_rad_per_s": simulated.natural_frequency_rad_per_s,
        "model.damping_ratio": simulated.damping_ratio,
        "model.output_delay_s": simulated.actuation_delay_s,
        "model.output_lag_s": simulated.output_lag_s,
    }
    found = {one.quantity: one for one in result_of(record).values}
    assert found.keys() == truth.keys()
    sure: dict[str, float] = {}
    for quantity, true in truth.items():
        one = found[quantity]
        assert one.uncertainty is not None
        assert abs(one.value - true) <= 3.0 * one.uncertainty, quantity
        sure[quantity] = one.uncertainty
    # Law and estimator receive them on arming, like every calibrated quantity.
    values = {quantity: one.value for quantity, one in found.items()}
    loaded = calibrated_rig(rig, Calibration(values=values, sources={}))
    delay_s, lag_s = values["model.output_delay_s"], values["model.output_lag_s"]
    assert loaded.model.output(rig.rig.period_s) == (delay_s, lag_s)
    assert configure(loaded).output == (delay_s, lag_s)
    assert sure["model.output_delay_s"] < 0.2 * rig.rig.period_s
    assert sure["model.natural_frequency_rad_per_s"] < 1.0
