"""Instruments that fail on their real lines, by commands to the simulated rig; T = 20 ms.

Only the driver sees these faults of a line: a socket that disconnects, replies that are late or
lost, a module whose host has died.
"""

from collections.abc import Generator
from time import monotonic, sleep

import pytest

from pincette.config.reading import laid_over
from pincette.core.messages import GroundTruth, Position, SimCommand
from pincette.core.topics import SIM_COMMAND
from pincette.core.wording import fault_text
from pincette.instruments.link import RETRY_S
from tests.support.grips import (
    SHORT,
    approach,
    command,
    hold,
    kill,
    make_ready,
    refused,
    reset,
    restart,
    whole_grip,
)
from tests.support.reactions import REACTION_S, await_reaction, within
from tests.support.rigs import demo_rig
from tests.support.running import RunningRig, running_rig
from tests.support.stalls import StallRecorder
from tests.support.witness import Witness

pytestmark = pytest.mark.usefixtures("stalls")

WATCHDOG_S = 0.5
IDLE_S = 0.05
"""Interval at which the simulated module checks its watchdog while its line is quiet, in s."""
TICK_S = 0.1
"""Tick of the module's watchdog, by its manual, in s."""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    own = laid_over(
        SHORT,
        {
            "simulation": {"scripts": True},
            "output": {"options": {"watchdog_s": WATCHDOG_S}},
        },
    )
    with running_rig(demo_rig(own), tmp_path_factory.mktemp("rig")) as running:
        yield running


@pytest.fixture(autouse=True)
def ready(rig: RunningRig, seen: Witness) -> None:
    heal(seen)
    make_ready(rig)


def order(seen: Witness, target: str, what: str, value: float | None = None) -> float:
    """Disturb the rig; returns the time."""
    now = monotonic()
    seen.bus.call(SIM_COMMAND, SimCommand(target, what, value))
    return now


def heal(seen: Witness) -> None:
    """Plug everything in again, and check that the sensor measures."""
    for target in ("sensor", "output"):
        order(seen, target, "heal")
    seen.until(Position, lambda position: position.arms[0].valid, monotonic())


def check_works_again(rig: RunningRig, seen: Witness) -> None:
    """Check that nothing moves until a person has reset the rig, that the next job succeeds, and
    that no program died."""
    assert refused(rig)["type"].endswith("rig-latched")
    reset_when_it_answers(rig)
    make_ready(rig)
    whole_grip(rig, seen)
    assert rig.fleet.ended() == []


def reset_when_it_answers(rig: RunningRig) -> None:
    """Check that a reset is refused, with the reason, until the output replies again."""
    path = f"/rigs/{rig.rig.rig.name}/reset"
    deadline = monotonic() + 4.0 * RETRY_S
    while (answer := rig.post(path, {"acknowledge": True})).status_code == 409:
        # A module that is connected again may still send late replies to earlier requests.
        assert any(name in answer.json()["detail"] for name in (rig.rig.output.url, "I-7024"))
        assert monotonic() < deadline, answer.text
        sleep(0.05)
    answer.raise_for_status()


def test_unplugging_the_sensor_cable_leads_to_a_safe_state_and_recovery(
    rig: RunningRig, seen: Witness, stalls: StallRecorder, figures: list[str]
) -> None:
    job = hold(rig, seen)
    pulled_s = order(seen, "sensor", "off", 1.0)
    reaction = await_reaction(rig.rig, seen, stalls, pulled_s, held=True)
    figures.append(
        f"sensor pulled, part held: safe state began "
        f"{1e3 * reaction.reaction_s:.0f} ms after, limit {1e3 * REACTION_S:.0f} ms"
    )
    ended = rig.ended(job)
    assert ended["state"] == "failed"
    assert "command_age" in ended["cause"]
    assert f"sensor: {rig.rig.sensor.url}" in ended["cause"]
    fault = fault_text(seen.newest(Position).arms[0].fault)
    assert rig.rig.sensor.url in fault
    deadline = monotonic() + 1.0
    while not any("sensor: reads no position" in reason for reason in rig.view()["reasons"]):
        assert monotonic() < deadline, rig.view()["reasons"]
    heal(seen)
    check_works_again(rig, seen)
    within(REACTION_S, reaction.reaction_s, "the reaction")


def test_unplugging_the_output_cable_leads_to_a_safe_state_and_recovery(
    rig: RunningRig, seen: Witness, figures: list[str]
) -> None:
    """No ramp arrives any more: the module's own watchdog makes the arm safe."""
    job = approach(rig, seen)
    pulled_s = order(seen, "output", "off", 1.0)
    safe_s = await_safe_output(seen, pulled_s)
    figures.append(f"output pulled: the module is safe {1e3 * safe_s:.0f} ms after")
    ended = rig.ended(job)
    assert ended["state"] == "failed"
    assert "device: " in ended["cause"]
    assert rig.rig.output.url in ended["cause"]
    heal(seen)
    check_works_again(rig, seen)
    within(WATCHDOG_S + TICK_S + IDLE_S, safe_s, "safety")


def test_the_module_becomes_safe_by_its_watchdog_if_the_actuator_dies(
    rig: RunningRig, seen: Witness, figures: list[str]
) -> None:
    job = hold(rig, seen)
    killed_s = kill(rig, "actuator")
    safe_s = await_safe_output(seen, killed_s)
    figures.append(f"actuator killed: the module is safe {1e3 * safe_s:.0f} ms after")
    ended = rig.ended(job)
    assert ended["state"] == "failed"
    assert "actuator" in ended["cause"]
    stands = rig.view()["standing"]
    assert (stands["state"], stands["part"]) == ("unknown", "unknown"), (
        "the newest message is too old"
    )
    assert stands["state_age_s"] > WATCHDOG_S - TICK_S
    restart(rig, "actuator")
    reset(rig)
    make_ready(rig)
    whole_grip(rig, seen)
    # The last feeding was up to a period before the kill.
    assert safe_s > WATCHDOG_S - 2.0 * rig.rig.rig.period_s
    within(WATCHDOG_S + TICK_S + IDLE_S, safe_s, "safety")


def await_safe_output(seen: Witness, since_s: float) -> float:
    """Seconds until the instrument applies its safe value on its own."""
    at_s, truth = seen.until(
        GroundTruth, lambda truth: truth.arms[0].voltage_V == 0.0, since_s + 0.2
    )
    assert truth.arms[0].voltage_V == 0.0
    return at_s - since_s


def test_the_command_line_can_operate_the_simulated_rig_too(rig: RunningRig, seen: Witness) -> None:
    before_um = seen.newest(Position).arms[0].x_um
    done = command("rig", "sensor", "wrong", "5", "--for-s", "0.5", "--rig", str(rig.path))
    assert done.returncode == 0, done.stderr
    seen.until(
        Position, lambda position: position.arms[0].x_um > before_um + 4.0, monotonic() - 1.0
    )
    sleep(0.6)
    assert abs(seen.newest(Position).arms[0].x_um - before_um) < 1.0
    wrong = command("rig", "sensor", "melt", "--rig", str(rig.path))
    assert wrong.returncode == 1
    assert "sensor has no operation 'melt'" in wrong.stderr
