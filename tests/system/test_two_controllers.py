"""A second controller, another rig file, and foreign programs on the key of the controller; T =
20 ms."""

import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic, sleep

import numpy as np
import pytest

from pincette.bus.topology import direct_session, endpoint
from pincette.bus.zenoh_bus import ZenohBus
from pincette.config.reading import laid_over
from pincette.core.messages import Applied, Command
from pincette.core.wording import applied_text
from tests.support.arms import with_arm
from tests.support.grips import hold, kill, make_ready, restart, whole_grip
from tests.support.hogs import hog
from tests.support.rigs import Tree, rig_toml
from tests.support.running import RunningRig
from tests.support.witness import Witness

pytestmark = pytest.mark.usefixtures("stalls", "ready")

LOOK_S = 1.5
FLOOD_S = 5.0
RATE_HZ = 500.0
"""Rate of the forged commands, ten times that of the controller."""
CPU_SHARE = 0.5
"""Largest share of one processor that the actuator may use for refusals."""
LOST = 12
"""Largest share of ticks in the flood, one in twenty, in which a forged command may have
displaced the true one."""
ACCOUNT_S = 0.3
"""Time before an unexpected trip from which messages are reported, in s."""
AGE_S = 0.010
"""Largest age of a command, in s: half a period."""


@contextmanager
def program(name: str, path: Path, log: Path) -> Generator["subprocess.Popen[str]"]:
    """Start a program in addition to the fleet, with a separate rig file."""
    words = [
        sys.executable,
        "-m",
        "pincette",
        "run",
        name,
        "--rig",
        str(path),
        "--exit-with-parent",
    ]
    with (
        log.open("w", encoding="utf-8") as stated,
        subprocess.Popen(words, stdin=subprocess.PIPE, stderr=stated, text=True) as process,
    ):
        try:
            yield process
        finally:
            if process.stdin is not None:
                process.stdin.close()
            process.wait(10.0)


def check_undisturbed(seen: Witness, since_s: float, most_lost: int = 0) -> list[Applied]:
    """Check that the actuator has used a command in each tick, except for a few."""
    echoes = seen.since(Applied, since_s)
    for at, echo in echoes:
        assert echo.state == "armed", f"{applied_text(echo)}\n{seen.account(at, ACCOUNT_S)}"
    lost = [echo.seq for _, echo in echoes if not echo.answered]
    assert len(lost) <= most_lost, f"no command was accepted for {lost}"
    return [echo for _, echo in echoes]


def commands_of(seen: Witness, owner: int, since_s: float) -> list[Command]:
    """Return the commands of one owner; the others are received here too."""
    return [one for _, one in seen.since(Command, since_s) if one.valid and one.owner == owner]


def release(rig: RunningRig, job: str) -> None:
    rig.post(f"/jobs/{job}/actions", {"type": "release"}).raise_for_status()
    assert rig.ended(job)["state"] == "succeeded"


def test_the_same_controller_cannot_be_started_twice(
    rig: RunningRig, seen: Witness, tmp_path: Path
) -> None:
    job = hold(rig, seen)
    since = monotonic()
    with program("controller", rig.path, tmp_path / "log") as second:
        assert second.wait(20.0) == 2
    text = (tmp_path / "log").read_text(encoding="utf-8")
    assert "in use" in text
    assert "a second start of this rig" in text
    check_undisturbed(seen, since)
    release(rig, job)


def test_commands_of_another_owner_never_mix_with_those_of_the_first(
    rig: RunningRig, seen: Witness
) -> None:
    """The foreign program is linked directly to the actuator: right epoch, new numbers, another
    owner."""
    job = hold(rig, seen)
    place = direct_session(rig.rig.bus.host, rig.rig.bus.port, "actuator")
    second = ZenohBus(place, rig.rig.rig.name, "second")
    try:
        before, since = seen.newest(Applied), monotonic()
        owner = seen.newest(Command).owner
        while monotonic() < since + LOOK_S:
            first = commands_of(seen, owner, monotonic() - 0.5)[-1]
            second.publish(with_arm(first, owner=first.owner + 1, seq=first.seq + 1, voltage_V=3.0))
            sleep(rig.rig.rig.period_s)
        echoes = check_undisturbed(seen, since)
    finally:
        second.close()
    asked_V = {one.seq: one.arms[0].voltage_V for one in commands_of(seen, owner, since - 0.5)}
    own = [echo for echo in echoes if echo.answered and echo.seq in asked_V]
    assert len(own) >= 0.8 * LOOK_S / rig.rig.rig.period_s
    for echo in own:
        off_V = abs(echo.arms[0].voltage_V - asked_V[echo.seq])
        assert echo.arms[0].limits_active or off_V <= 0.5 * rig.rig.output.step_V + 1e-12
    assert max(echo.arms[0].voltage_V for echo in echoes) < 3.0
    assert echoes[-1].refused - before.refused >= 0.5 * LOOK_S / rig.rig.rig.period_s
    release(rig, job)


def test_a_program_with_another_rig_file_is_named_and_not_armed(
    rig: RunningRig, seen: Witness, tmp_path: Path
) -> None:
    other: Tree = {"limits": {"force_max_mN": 35.0}}
    tree = laid_over(rig.rig.model_dump(mode="json"), other)
    path = tmp_path / "other.toml"
    path.write_text(rig_toml(type(rig.rig).model_validate(tree)), encoding="utf-8")
    kill(rig, "controller")
    rig.fleet.members["controller"].process.wait(5.0)
    since = monotonic()
    with program("controller", path, tmp_path / "log"):
        deadline = monotonic() + 20.0
        while not (reasons := " ".join(rig.view()["reasons"])).count("controller: runs"):
            assert monotonic() < deadline, reasons
            sleep(0.1)
        answer = rig.post("/jobs", {"kind": "grip", "autostart": True})
        assert answer.status_code in (409, 503), answer.text
        assert "controller" in answer.text
        assert rig.rig.digest() in reasons
    assert not [echo for _, echo in seen.since(Applied, since) if echo.state == "armed"]
    restart(rig, "controller")
    make_ready(rig)
    whole_grip(rig, seen)


def cpu_s(process: int) -> float:
    """Return the CPU time that a process has used, in s."""
    words = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / 100.0


def test_an_unauthorized_sender_floods_the_key_of_the_controller(
    rig: RunningRig, seen: Witness, figures: list[str]
) -> None:
    job = hold(rig, seen)
    actuator = rig.fleet.members["actuator"].process.pid
    place = endpoint(rig.rig.bus.host, rig.rig.bus.port, "actuator")
    quiet_s, spent_s = monotonic(), cpu_s(actuator)
    sleep(FLOOD_S)
    quiet = check_undisturbed(seen, quiet_s)
    quiet_share = (cpu_s(actuator) - spent_s) / (monotonic() - quiet_s)
    with hog("flood", place, rig.rig.rig.name, str(RATE_HZ)) as reported:
        sleep(1.0)
        flooded_s, spent_s = monotonic(), cpu_s(actuator)
        sleep(FLOOD_S)
        share = (cpu_s(actuator) - spent_s) / (monotonic() - flooded_s)
        echoes = check_undisturbed(seen, flooded_s, LOST)
        unanswered = sum(not echo.answered for echo in echoes)
    before, after = (
        float(np.percentile([echo.command_age_s for echo in some if echo.answered], 99.0))
        for some in (quiet, echoes)
    )
    figures.append(
        f"flood at the actuator: {sum(reported['sent'].values()) / reported['for_s']:.0f} per s, "
        f"{echoes[-1].refused - quiet[-1].refused} refused by the actuator, which took "
        f"{100.0 * share:.0f} % of a processor, {100.0 * quiet_share:.0f} % before; "
        f"{unanswered} of {len(echoes)} ticks without a command; "
        f"command age p99 {1e3 * before:.2f} ms before, {1e3 * after:.2f} ms meanwhile"
    )
    assert set(reported["sent"]) >= {"garbage", "foreign owner", "old epoch", "replay"}
    assert sum(reported["sent"].values()) >= 0.8 * RATE_HZ * FLOOD_S
    assert max(echo.arms[0].voltage_V for echo in echoes) < 3.0
    assert echoes[-1].refused > quiet[-1].refused
    assert share <= CPU_SHARE
    assert after <= max(AGE_S, 2.0 * before)
    release(rig, job)
