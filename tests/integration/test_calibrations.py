"""Calibrations played by the whole loop on a simulated rig, and what they propose against truth."""

from collections.abc import Callable
from functools import partial
from typing import Any, cast

import pytest
from pydantic import TypeAdapter

from pincette.config import RigFile, read_rig
from pincette.messages import Act, Message, Sample, Telemetry
from pincette.runtime import devices
from pincette.runtime.composed import ComposedLoop
from pincette.sim.bench import Bench
from pincette.topics import ACT, TELEMETRY, Topic
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.records.archive import Take
from pincette_supervisor.records.calibration_record import CalibrationRecord, gather
from pincette_supervisor.schemas.request_models import AnyJobRequest, Body
from tests.support.rigs import DEMO, Tree, at_own_ports, demo_rig

REQUEST: TypeAdapter[AnyJobRequest] = TypeAdapter(Body)
WITHIN = 0.02
"""Largest deviation from the truth."""
HANDS_TICKS = 25
"""How long a person takes to hang a weight."""
AWAY: Tree = {"simulation": {"bead": False}}


class Bystander:
    """A person at the bench: hangs what the program asks for, and says to go on."""

    def __init__(self, loop: ComposedLoop, bench: Bench, planned: Planned) -> None:
        self.loop, self.bench, self.planned = loop, bench, planned
        self.hung: list[float] = []
        self.waited = 0
        loop.bus.subscribe(TELEMETRY, self._look)

    def _look(self, _topic: Topic, message: Message) -> None:
        wait = self.planned.waits.get(cast(Telemetry, message).segment)
        if wait is None or not cast(Telemetry, message).playing:
            self.waited = 0
            return
        self.waited += 1
        if self.waited == HANDS_TICKS:
            weight_mN = wait.weight_mN
            assert weight_mN is not None
            assert f"{weight_mN:g}" in wait.instruction or "every weight" in wait.instruction
            self.hang(weight_mN)
            self.loop.bus.ask(ACT, Act("continue"))

    def hang(self, weight_mN: float) -> None:
        self.bench.rig.hang(weight_mN)
        self.hung.append(weight_mN)


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> list[Bench]:
    """Benches as they are opened, so that a person can lay hands on them."""
    opened: list[Bench] = []
    opening: Callable[..., Bench] = devices.open_bench

    def keep(*arguments: Any, **named: Any) -> Bench:
        opened.append(opening(*arguments, **named))
        return opened[-1]

    monkeypatch.setattr(devices, "open_bench", keep)
    return opened


def calibrated(
    rig: RigFile, bench: list[Bench], calibration: str, fault: str = "", **wishes: Any
) -> tuple[CalibrationRecord, Bystander]:
    """A calibration played to its end, as it would be kept."""
    body = {"kind": "calibrate", "calibration": calibration, **wishes}
    planned = plan_job(REQUEST.validate_python(body), rig)
    assert planned.plan.violations == []
    loop = ComposedLoop(rig)
    person = Bystander(loop, bench[-1], planned)
    messages: list[Message] = [
        message
        for message in loop.play(planned.program)
        if not isinstance(message, Sample) or message.seq >= 0
    ]
    row = JobRow("job", "calibrate", rig.rig.name, "running", body, {}, "")
    record = gather(rig, row, planned, Take(1, messages))
    assert fault in record.fault
    assert bool(fault) == bool(record.fault)
    assert record.result.outcome == "moved"
    return record, person


def value(record: CalibrationRecord, quantity: str) -> Any:
    found = {item.quantity: item for item in record.result.values}
    return found[quantity].value


played = partial(demo_rig, AWAY, time="lockstep")


def test_the_noise_is_that_of_the_sensor(bench: list[Bench]) -> None:
    rig = played()
    assert rig.simulation is not None
    record, _ = calibrated(rig, bench, "noise")
    simulated = rig.simulation
    # A step of q adds q²/12 to the variance of the readings.
    true_um = (simulated.sensor_noise_um**2 + simulated.sensor_step_um**2 / 12.0) ** 0.5
    assert value(record, "sensor.noise_um") == pytest.approx(true_um, rel=0.1)
    figures = {figure.name: figure.value for figure in record.result.figures}
    # The display rounds multiples of the step to 0.01 µm.
    assert figures["step"] == pytest.approx(simulated.sensor_step_um, abs=0.0051)


def test_weights_hung_as_the_job_asks_give_the_compliance(bench: list[Bench]) -> None:
    rig = played()
    assert rig.simulation is not None
    weights = [0.0, 5.0, 10.0, 20.0]
    record, person = calibrated(rig, bench, "compliance", weights_mN=weights)
    assert person.hung == [0.0, 5.0, 10.0, 20.0, 10.0, 5.0, 0.0]
    found = value(record, "model.compliance_um_per_mN")
    assert found == pytest.approx(rig.simulation.compliance_um_per_mN, rel=WITHIN)
    (item,) = record.result.values
    assert item.uncertainty is not None
    assert 0.0 < item.uncertainty < WITHIN * found


def test_weights_that_nobody_hung_give_no_compliance(
    bench: list[Bench], monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = played()

    def forget(_person: Bystander, _weight_mN: float) -> None:
        return

    monkeypatch.setattr(Bystander, "hang", forget)
    record, _ = calibrated(rig, bench, "compliance", "were the weights hung")
    assert record.result.values == []


def test_the_free_response_has_the_secant_gain_of_the_rig(bench: list[Bench]) -> None:
    rig = played()
    record, _ = calibrated(rig, bench, "free_response")
    # The demo rig is set to the paper's 19.0 µm/V at 2 V peak to peak.
    assert value(record, "model.piezo_um_per_V") == pytest.approx(19.0, rel=WITHIN)
    taught = value(record, "model.free_response")
    assert taught["residual_um"] < 0.3
    figures = {figure.name: figure.value for figure in record.result.figures}
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
    assert record.result.warnings == [
        f"rests on {quantity}, which is assumed: calibrate it first"
        for quantity in ("model.compliance_um_per_mN", "model.free_response")
    ]


def test_a_sweep_through_the_buffers_of_the_fast_pair_finds_the_mode(bench: list[Bench]) -> None:
    rig = at_own_ports(read_rig(DEMO.parent / "fast.toml"), {"rig": {"time": "lockstep"}, **AWAY})
    assert rig.simulation is not None
    record, _ = calibrated(rig, bench, "frequency_response", duration_s=10.0)
    simulated = rig.simulation
    omega_n = value(record, "model.natural_frequency_rad_per_s")
    assert omega_n == pytest.approx(simulated.natural_frequency_rad_per_s, rel=0.002)
    zeta = value(record, "model.damping_ratio")
    assert zeta == pytest.approx(simulated.damping_ratio, rel=0.05)
