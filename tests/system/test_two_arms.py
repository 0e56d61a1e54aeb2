"""Faults of programs and instruments of two arms while both hold a part; T = 20 ms."""

import signal
from collections.abc import Generator
from time import monotonic, sleep

import pytest

from pincette.core.messages import Applied, GroundTruth, Position, SimCommand, Telemetry
from pincette.core.topics import SIM_COMMAND
from pincette.core.wording import applied_text
from pincette_actuator.config import configure
from tests.support.grips import kill, make_ready, restart
from tests.support.reactions import TRIPPED, within
from tests.support.rigs import Tree, at_own_ports, output_step_V
from tests.support.running import RunningRig, running_rig
from tests.support.two_arms import FORCE_MN, two_arm_rig
from tests.support.witness import Witness

pytestmark = pytest.mark.usefixtures("stalls")

SHORT: Tree = {
    # A machine that stalls for 30 ms trips with the default limit;
    # tests/integration/faults/test_two_arms.py tests that limit in virtual time.
    "safety": {"command_age_periods": 4.5},
    "grip": {
        "force_mN": FORCE_MN,
        "hold_s": 0.4,
        "load_s": 0.4,
        "approach_um_per_s": 20.0,
        "seek_um_per_s": 8.0,
        "zero_s": 0.24,
    },
}
NOTICED_S = 0.010
"""Longest time after the age limit until the echo of the freeze is received, in s."""
WATCHDOG_S, TICK_S, IDLE_S = 0.5, 0.1, 0.05
ASIDE_S = TICK_S + IDLE_S + 0.04
"""Largest delay between the actions of the two outputs' watchdogs, in s."""
ENDS_S = 20.0
HEALED_S = 10.0
"""Longest time until both sensors are read again, in s."""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    own = at_own_ports(two_arm_rig(SHORT, time="real"))
    with running_rig(own, tmp_path_factory.mktemp("rig")) as running:
        yield running


@pytest.fixture(autouse=True)
def ready(rig: RunningRig, seen: Witness) -> None:
    for target in ("sensor", "output", "second_sensor", "second_output"):
        order(seen, target, "heal")
    make_ready(rig)
    # A line that was silent may be reopened after its recovery.
    seen.until(Position, lambda position: position.usable, monotonic(), HEALED_S)
    place_part(seen)


def order(seen: Witness, target: str, what: str) -> float:
    """Disturb the rig; returns the time."""
    now = monotonic()
    seen.bus.call(SIM_COMMAND, SimCommand(target, what))
    return now


def place_part(seen: Witness) -> None:
    """Put the part back from where it was released."""
    order(seen, "part", "place")


def hold(rig: RunningRig, seen: Witness) -> str:
    """Grip with both arms and wait for the hold; returns the job's id."""
    begun = monotonic()
    job = rig.start_grip(kind="grip", until_released=True)
    while monotonic() < begun + ENDS_S:
        views = [view for _, view in seen.since(Telemetry, begun)]
        if any(view.phase == "hold" and view.segment_tick >= 5 for view in views):
            return job
        sleep(0.005)
    raise TimeoutError(f"the job does not reach its hold: {rig.job(job)}")


def check_together(rig: RunningRig, seen: Witness, fault_s: float) -> None:
    """Check that both are frozen in time, keep their voltages, and are ramped in the same ticks."""
    seen.until_state(("latched",), fault_s)
    tripped = [(at, echo) for at, echo in seen.since(Applied, fault_s) if echo.state in TRIPPED]
    reacted_s, first = tripped[0]
    assert first.state == "frozen", applied_text(first)
    print(f"{applied_text(first)}: after {1e3 * (reacted_s - fault_s):.0f} ms")
    within(configure(rig.rig).age.limit_s + NOTICED_S, reacted_s - fault_s, applied_text(first))
    pairs = [(echo.state, voltages(echo)) for _, echo in tripped]
    assert len({pair for state, pair in pairs if state == "frozen"}) == 1
    ramp = [pair for state, pair in pairs if state == "ramping"]
    assert ramp
    for arm in (0, 1):
        away_V = [abs(pair[arm]) for pair in ramp]
        assert away_V == sorted(away_V, reverse=True)
    assert voltages(seen.newest(Applied)) == (0.0, 0.0)
    step_V = output_step_V(rig.rig.arms[0])
    seen.until(GroundTruth, lambda truth: max(map(abs, put_out(truth))) <= step_V, reacted_s, 1.0)
    check_force(seen, fault_s)


def check_force(seen: Witness, since_s: float) -> None:
    """Check that no arm has pressed harder than planned."""
    truths = [truth for _, truth in seen.since(GroundTruth, since_s)]
    hardest_mN = max(max(truth.arms[0].force_mN, of_second(truth)) for truth in truths)
    assert hardest_mN <= 1.15 * FORCE_MN


def voltages(echo: Applied) -> tuple[float, float]:
    assert len(echo.arms) == 2
    return echo.arms[0].voltage_V, echo.arms[1].voltage_V


def put_out(truth: GroundTruth) -> tuple[float, float]:
    assert len(truth.arms) == 2
    return truth.arms[0].voltage_V, truth.arms[1].voltage_V


def of_second(truth: GroundTruth) -> float:
    assert len(truth.arms) == 2
    return truth.arms[1].force_mN


def test_a_grip_with_both_arms_succeeds(rig: RunningRig, seen: Witness) -> None:
    begun = monotonic()
    ended = rig.ended(rig.start_grip(kind="grip"))
    assert ended["state"] == "succeeded", ended["cause"]
    check_force(seen, begun)
    assert all(len(echo.arms) == 2 for _, echo in seen.since(Applied, begun))


def test_a_program_that_is_killed_or_hangs_stops_both_arms(rig: RunningRig, seen: Witness) -> None:
    name = "controller"
    job = hold(rig, seen)
    check_together(rig, seen, kill(rig, name))
    assert rig.ended(job)["state"] == "failed"
    restart(rig, name)
    make_ready(rig)
    place_part(seen)
    job = hold(rig, seen)
    hung_s = monotonic()
    rig.fleet.signal(name, signal.SIGSTOP)
    try:
        check_together(rig, seen, hung_s)
    finally:
        rig.fleet.signal(name, signal.SIGCONT)
    assert rig.ended(job)["state"] == "failed"


def test_both_outputs_release_by_their_watchdogs_if_the_actuator_is_dead(
    rig: RunningRig, seen: Witness
) -> None:
    """Both watchdogs have acted at nearly the same time."""
    hold(rig, seen)
    since_s = monotonic()
    rig.fleet.signal("actuator", signal.SIGKILL)
    step_V = output_step_V(rig.rig.arms[0])
    seen.until(GroundTruth, lambda truth: max(map(abs, put_out(truth))) <= step_V, since_s, 3.0)
    truths = seen.since(GroundTruth, since_s)
    safe_s = [
        next(at for at, truth in truths if abs(put_out(truth)[arm]) <= step_V) for arm in (0, 1)
    ]
    print(f"safe after {safe_s[0] - since_s:.3f} and {safe_s[1] - since_s:.3f} s")
    within(WATCHDOG_S + 2.0 * TICK_S + IDLE_S, max(safe_s) - since_s, "safety")
    within(ASIDE_S, abs(safe_s[0] - safe_s[1]), "the second arm after the first")
    check_force(seen, since_s)
