"""Findings of doctor in rig files and in instruments' replies; without ports, in no time."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from pincette.cli.doctor import findings, moved
from pincette.config import Output, RigFile, Sensor, read_rig
from pincette.core import plugins
from pincette.core.service import AnyService
from pincette.diagnostics import Finding
from pincette.diagnostics.instruments import (
    Limits,
    direction,
    instruments,
    latency,
    margin,
    readings,
)
from pincette.diagnostics.machine import shared_ports
from pincette.diagnostics.rig_file import limits, model, rig_findings, timing, watchdog
from pincette.engine.exchange_times import times_of
from pincette.engine.instrument import Device
from pincette.instruments.line.memory_link import MemoryLink
from pincette.instruments.protocols import InstrumentError, PositionSensor, VoltageOutput
from pincette.sim.instruments.dcon import SimulatedI7024
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.rig.rig import SimulatedRig

DEMO = Path(__file__).parents[3] / "deploy/rigs/demo.toml"
TWO_ARMS = read_rig(DEMO.with_name("two-arms.toml"))
RIG = read_rig(DEMO)


def changed(**tables: dict[str, object]) -> RigFile:
    """The demo rig with changes to its tables."""
    update = {name: getattr(RIG, name).model_copy(update=own) for name, own in tables.items()}
    return RIG.model_copy(update=update)


def missing(found: Iterator[Finding]) -> list[str]:
    return [finding.what for finding in found if finding.mark == "missing"]


class Bench:
    """The demo's instruments over memory, with the arm at rest; each reading takes a
    millisecond."""

    def __init__(self, unit: str = "um", flipped: bool = False) -> None:
        assert RIG.simulation is not None
        self.time_s = 0.0
        self.written_V: list[float] = []
        rig = SimulatedRig(RIG.simulation, 0.02, False, self.clock_s)
        sign = -1.0 if flipped else 1.0
        keyence = SimulatedKeyence(lambda: sign * rig.measure_um(), "um")

        def put_out(voltage_V: float) -> None:
            self.written_V.append(voltage_V)
            rig.put_out(voltage_V)

        module = SimulatedI7024(put_out, rig.now_s)
        settings = RIG.sensor.model_copy(update={"options": {"unit": unit}})
        self.sensor: PositionSensor = plugins.load(plugins.POSITION_SENSORS, "keyence_lkg")(
            settings, MemoryLink(keyence.answer)
        )
        self.output: VoltageOutput = plugins.load(plugins.VOLTAGE_OUTPUTS, "icpdas_i7024")(
            RIG.output, MemoryLink(module.answer)
        )

    def clock_s(self) -> float:
        self.time_s += 0.001
        return self.time_s

    def sleep(self, duration_s: float) -> None:
        self.time_s += duration_s

    def open_device(self, service: AnyService, _rig: RigFile) -> Device:
        return self.sensor if service.instrument == "position_sensor" else self.output


class Constant:
    """A sensor that shows given readings in turn."""

    def __init__(self, *readings_um: float) -> None:
        self._readings_um, self._count = readings_um, 0

    def read_um(self) -> float:
        self._count += 1
        return self._readings_um[self._count % len(self._readings_um)]

    def close(self) -> None:
        pass


def test_the_demo_has_no_missing_finding(tmp_path: Path) -> None:
    assert missing(rig_findings(RIG)) == []
    assert missing(shared_ports(RIG)) == []
    reported = [finding.what for finding in findings(DEMO, tmp_path)]
    assert any("with real ones, doctor checks" in what for what in reported)


def test_a_port_conflict_names_both_users() -> None:
    url = f"socket://127.0.0.1:{RIG.bus.port + 1}"
    (what,) = missing(shared_ports(changed(sensor={"url": url})))
    assert what == f"ports: {RIG.bus.port + 1} is given to sensor and the sensor"
    same = changed(sensor={"url": "/dev/ttyUSB0"}, output={"url": "/dev/ttyUSB0"})
    (what,) = missing(shared_ports(same))
    assert what == "ports: /dev/ttyUSB0 is given to the sensor and the output"
    (what,) = missing(shared_ports(changed(supervisor={"port": RIG.bus.port})))
    assert "the router and the supervisor" in what


def test_two_lines_that_together_exceed_the_period_are_reported_with_their_sum() -> None:
    slow = changed(sensor={"options": {"baud": 38400}}, output={"options": {"baud": 38400}})
    finding = timing(slow)
    assert not finding.ok
    assert "above the control period of 20 ms" in finding.what
    assert "sensor exchange 5.5" in finding.what
    assert "baud" in finding.remedy
    assert timing(RIG).ok


def test_the_rig_file_must_state_what_the_output_does_without_messages() -> None:
    assert "0.5 s after the last message from its host" in watchdog(RIG).what
    without: dict[str, object] = {"driver": "srs_dc205", "options": {}}
    off: dict[str, object] = {"options": {"watchdog_s": 0.0}}
    for options in (without, off):
        finding = watchdog(changed(output=options))
        assert finding.mark == "missing"
        assert "output.on_silence = 'unstated'" in finding.what
        assert "on_silence = 'safe' or 'holds'" in finding.remedy
        stated = watchdog(changed(output={**options, "on_silence": "holds"}))
        assert stated.mark == "note"
        assert "keeps its last voltage" in stated.what


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"safety": {"safe_V": 5.0}}, "safe_V = 5.0 V is outside -1.0..4.0 V"),
        ({"part": {"contact_um": 65.0}}, "pressed with 40 mN at 83.4 µm, position limits -20..70"),
        ({"limits": {"force_max_mN": 10.0}}, "presses with 20 mN, limit 10 mN"),
        ({"limits": {"voltage_max_V": 2.0}}, "needs about 2.55 V, limit 2 V"),
        ({"limits": {"sweep_V": 0.2}}, "a sweep of ±0.2 V moves the arm by ±73.1 µm"),
    ],
)
def test_limits_that_forbid_a_grip_are_named_with_their_numbers(
    tables: dict[str, dict[str, object]], words: str
) -> None:
    assert any(words in what for what in missing(limits(changed(**tables))))


def test_assumed_values_of_the_model_are_reported_without_blocking() -> None:
    bare = read_rig(DEMO.with_name("bring-up.toml"))
    finding = model(bare)
    assert finding.mark == "note"
    assert "model.compliance_um_per_mN" in finding.what
    assert "sensor.noise_um" not in finding.what
    assert "pincette job calibrate" in finding.remedy


def test_an_untested_driver_is_reported_on_a_real_rig() -> None:
    real = RIG.model_copy(update={"simulation": None})
    notes = [finding.what for finding in rig_findings(real) if finding.mark == "note"]
    assert sum("has not been tested with its instrument" in note for note in notes) == 2


def test_an_unknown_driver_and_a_wrong_option_are_reported() -> None:
    (first, *_) = missing(rig_findings(changed(sensor={"driver": "other"})))
    assert first == "driver other"
    assert any(
        "bauds" in what for what in missing(rig_findings(changed(output={"options": {"bauds": 1}})))
    )


def test_doctor_has_no_findings_for_working_instruments(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        "pincette.diagnostics.instruments.open_for_measurement", Bench().open_device
    )
    found = list(instruments(RIG))
    assert missing(iter(found)) == []
    text = "\n".join(finding.what for finding in found)
    assert "output: stands at +0.000 V" in text
    assert "sensor: readings differ by 0.0" in text


def test_an_instrument_that_cannot_be_opened_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(service: AnyService, _rig: RigFile) -> Device:
        raise InstrumentError(f"{service.name} is not there", "cannot_open")

    monkeypatch.setattr("pincette.diagnostics.instruments.open_for_measurement", fail)
    assert missing(instruments(RIG)) == [
        "sensor: sensor is not there",
        "output: actuator is not there",
    ]


def test_a_wrong_unit_a_coarse_resolution_and_noise_are_found() -> None:
    settings: Sensor = RIG.sensor
    with pytest.raises(InstrumentError, match="steps of 10 µm"):
        Bench(unit="mm")
    (what,) = missing(readings(settings, Constant(5.0, 5.1), 0.016, []))
    assert what == "sensor: readings differ by 0.1 µm at least, limits 0.001 and 0.05 µm"
    (what,) = missing(readings(settings, Constant(0.00123, 0.00124), 0.016, []))
    assert "differ by 1e-05 µm" in what
    (what,) = missing(readings(settings, Constant(5.0, 5.01, 6.0, 7.0), 0.016, []))
    assert "noise 0.837 µm" in what
    assert "the rig file has 0.03 µm" in what
    (what,) = missing(readings(settings, Constant(20000.0, 20000.02), 0.016, []))
    assert "range -9999..9999 µm" in what
    (*_, finding) = readings(settings, Constant(5.0), 0.016, [])
    assert finding.mark == "note"


@pytest.mark.parametrize(("held_ms", "ok"), [(1, True), (16, False)])
def test_the_latency_of_a_usb_adapter_is_read(tmp_path: Path, held_ms: int, ok: bool) -> None:
    folder = tmp_path / "ttyUSB9"
    folder.mkdir()
    (folder / "latency_timer").write_text(f"{held_ms}\n", encoding="ascii")
    (finding,) = latency("/dev/ttyUSB9", tmp_path)
    assert finding.ok == ok
    assert f"{held_ms} ms, limit 1 ms" in finding.what
    assert "latency_timer" in finding.remedy
    assert list(latency("/dev/ttyS0", tmp_path)) == []
    assert list(latency("socket://127.0.0.1:1", tmp_path)) == []


def test_the_direction_is_found_and_the_voltage_is_restored() -> None:
    bench = Bench()
    finding = direction(RIG, bench.sensor, bench.output, bench.sleep)
    assert finding.ok
    assert "about +3.80 µm" in finding.what
    assert bench.output.read_V() == 0.0


def test_if_the_reading_falls_the_opposite_direction_is_recommended() -> None:
    bench = Bench(flipped=True)
    finding = direction(RIG, bench.sensor, bench.output, bench.sleep)
    assert finding.mark == "missing"
    assert "write direction = -1 into [sensor]" in finding.remedy
    turned = changed(sensor={"direction": -1})
    assert direction(turned, bench.sensor, bench.output, bench.sleep).ok


def test_a_sensor_whose_readings_are_one_exchange_old_is_found_by_a_move() -> None:
    """As behind a proxy that always gives the previous answer."""

    class Previous(Constant):
        def __init__(self, sensor: PositionSensor) -> None:
            self._sensor, self._kept_um = sensor, sensor.read_um()

        def read_um(self) -> float:
            previous_um, self._kept_um = self._kept_um, self._sensor.read_um()
            return previous_um

    bench = Bench()
    finding = direction(RIG, Previous(bench.sensor), bench.output, bench.sleep)
    assert not finding.ok
    assert "one exchange late" in finding.what
    assert "forwards bytes" in finding.remedy
    assert bench.output.read_V() == 0.0


def test_an_arm_that_does_not_move_is_found() -> None:
    finding = direction(RIG, Constant(5.0, 5.02), Bench().output, Bench().sleep)
    assert not finding.ok
    assert "amplifier is on" in finding.remedy


def test_the_voltage_is_restored_if_the_sensor_fails_during_the_move() -> None:
    class Failing(Constant):
        def read_um(self) -> float:
            if self._count >= 50:
                raise InstrumentError("gone", "silent")
            return super().read_um()

    bench = Bench()
    with pytest.raises(InstrumentError, match="gone"):
        direction(RIG, Failing(5.0), bench.output, bench.sleep)
    assert bench.output.read_V() == 0.0


def test_without_room_below_the_limit_nothing_moves() -> None:
    bench = Bench()
    tight = changed(limits={"voltage_max_V": 0.1})
    finding = direction(tight, bench.sensor, bench.output, bench.sleep)
    assert not finding.ok
    assert bench.written_V == []


def test_nothing_moves_without_consent(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench()
    monkeypatch.setattr("pincette.diagnostics.instruments.open_for_measurement", bench.open_device)
    assert moved(RIG, lambda question: "0.2 V" not in question).mark == "missing"
    assert bench.written_V == []


def test_a_simulated_rig_is_not_moved(tmp_path: Path) -> None:
    found = list(findings(DEMO, tmp_path, lambda _question: True))
    assert found[-1].mark == "missing"
    assert "leave --move to a rig that is real" in found[-1].remedy


def test_an_external_driver_without_options_has_no_watchdog() -> None:
    output = Output(driver="srs_dc205", url="/dev/ttyUSB0", on_silence="safe")
    assert "to a safe value on its own" in watchdog(RIG.model_copy(update={"output": output})).what


@pytest.mark.parametrize(
    ("slowest_s", "mark"), [(0.002, "ok"), (0.0079, "ok"), (0.0081, "note"), (0.05, "note")]
)
def test_readings_close_to_their_timeout_are_noted(slowest_s: float, mark: str) -> None:
    took = times_of([0.0018] * 39 + [slowest_s])
    assert took is not None
    found = margin("sensor: readings", took, 0.016)
    assert found.mark == mark
    assert f"1.8/1.8/{1e3 * slowest_s:.1f} ms" in found.what
    assert "later than 16.0 ms is late" in found.what


def test_exchanges_that_are_usually_late_are_reported_as_missing() -> None:
    took = times_of([0.027] * 40)
    assert took is not None
    assert margin("sensor: readings", took, 0.016).mark == "missing"


def test_both_arms_of_a_rig_share_the_limit_of_a_reading() -> None:
    alone, together = Limits.of(RIG), Limits.of(TWO_ARMS)
    assert alone.reading_s == pytest.approx(0.8 * 0.02)
    assert together.reading_s == pytest.approx(0.5 * 0.02)
    assert together.output_s == pytest.approx(0.5 * 0.02)
