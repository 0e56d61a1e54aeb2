"""A rig over mutual TLS, attacked by intruders: none of their messages is accepted, and the loop
continues.

Real processes, real time. The intruders put valid commands on the controller's key, exactly, with
wildcards and as a deletion, through the router and at the actuator's own port, and send requests
that only the supervisor may send.
"""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import random
import re
from collections.abc import Generator
from itertools import product
from pathlib import Path
from time import monotonic, sleep

import pytest
import zenoh
from msgspec.structs import replace

from pincette.core.codec import encode
from pincette.core.faults import Cause
from pincette.core.messages import Applied, Arm, Command, Load, Message, Reset, Telemetry, Trip
from pincette.core.topics import ARM, COMMAND, LOAD, RESET, TRIP, Request, key
from pincette.security.establishing import enrol
from pincette.security.folder import Folder
from pincette.security.identity import program
from tests.support.arms import with_arm
from tests.support.certificates import NOW, Intruder, ask, folder_for, stranger
from tests.support.commands import pincette
from tests.support.grips import SHORT, hold, make_ready, reset
from tests.support.rigs import demo_rig
from tests.support.running import RunningRig, running_rig
from tests.support.scripted import PROGRAM
from tests.support.witness import Witness

pytestmark = pytest.mark.usefixtures("stalls")

RIG = "demo"
SEED = 20131
FORGED_V = 2.75
"""Voltage that intruders command, in V; no grip of this rig comes near it."""
ROUNDS = 10
PAUSE_S = 0.02
READY_S = 30.0
KEYS = ("demo/command", "demo/*", "*/command", "demo/**", "**")
NOBODY = "http://127.0.0.1:1"
"""Address at which no supervisor replies."""
ENDS = ("succeeded", "stopped", "aborted", "failed", "interrupted")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    made = folder_for(tmp_path_factory.mktemp("certificates") / "pki", RIG)
    enrol(made, "right", (), NOW)
    return made


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory, folder: Folder) -> Generator[RunningRig]:
    secured = demo_rig(SHORT).secured(folder.path)
    with running_rig(secured, tmp_path_factory.mktemp("rig")) as running:
        yield running


@pytest.fixture
def held(rig: RunningRig, seen: Witness) -> Generator[str]:
    """Run a job that holds its part, from before the intrusion until after it."""
    make_ready(rig, READY_S)
    yield hold(rig, seen)
    make_ready(rig, READY_S)


def ports(rig: RunningRig) -> tuple[int, int]:
    """Port of the router, and that of the actuator."""
    return rig.rig.bus.port, rig.rig.bus.port + 4


def intrude(session: "zenoh.Session", seen: Witness, chance: random.Random) -> None:
    """Put forged commands that differ from the next true one only in their voltage."""
    for _ in range(ROUNDS):
        true = seen.newest(Command)
        forged = with_arm(true, seq=true.seq + chance.randint(0, 3), voltage_V=FORGED_V)
        for place in KEYS:
            session.put(f"pincette/v2/{place}", encode(forged))
            session.delete(f"pincette/v2/{place}")
        sleep(PAUSE_S)


def questions(rig: RunningRig) -> list[tuple[Request, Message]]:
    """Return the requests that move, stop or arm a rig."""
    arm = Arm(2**45, 1, rig.rig.digest())
    return [
        (TRIP, Trip(Cause.ESTOP)),
        (RESET, Reset(acknowledge=True)),
        (LOAD, Load(PROGRAM)),
        *((question, arm) for question in ARM.values()),
    ]


def assert_untouched(seen: Witness, since_s: float) -> None:
    """Check that the loop has continued in its epoch, only on the controller's commands."""
    applied = [message for _, message in seen.since(Applied, since_s)]
    first, last = applied[0], applied[-1]
    assert {(one.state, one.cause, one.refused) for one in applied} == {
        ("armed", "", first.refused)
    }
    assert {one.epoch for one in applied} == {first.epoch}
    assert all(one.arms[0].voltage_V < FORGED_V / 2 for one in applied)
    assert last.seq > first.seq
    assert all(view.playing for _, view in seen.since(Telemetry, since_s))


@pytest.mark.parametrize("who", ["right/controller", "operator"])
def test_a_certificate_of_another_program_can_neither_command_nor_query(
    rig: RunningRig, seen: Witness, folder: Folder, held: str, who: str
) -> None:
    chance = random.Random(SEED)
    intruder = Intruder(who, folder.credentials(folder.named(who)))
    begun = monotonic()
    answers: list[str] = []
    for port in ports(rig):
        with intruder.joined(rig.rig.bus.host, port) as session:
            intrude(session, seen, chance)
            for question, request in questions(rig):
                if not (who == "operator" and question == TRIP):
                    answers += ask(session, RIG, question, request)
    sleep(5 * rig.rig.rig.period_s)
    assert answers == []
    assert_untouched(seen, begun)
    assert rig.job(held)["state"] == "running"


def test_a_client_without_a_certificate_is_not_admitted(
    rig: RunningRig, seen: Witness, tmp_path: Path, held: str
) -> None:
    begun = monotonic()
    outsiders = [
        stranger(tmp_path / "rogue", RIG, program("controller", RIG)),
        Intruder("bare", None, "tls"),
        Intruder("plain", None, "tcp"),
    ]
    for outsider, port in product(outsiders, ports(rig)):
        with pytest.raises(zenoh.ZError), outsider.joined(rig.rig.bus.host, port):
            pass
    assert_untouched(seen, begun)
    assert rig.job(held)["state"] == "running"


def test_with_the_controllers_own_key_the_same_messages_arrive(
    rig: RunningRig, seen: Witness, folder: Folder, held: str
) -> None:
    """The messages of the other clients reach the actuator with this key, and are refused by
    another rule: owner."""
    thief = Intruder("thief", folder.credentials(program("controller", RIG)))
    before = seen.newest(Applied).refused
    begun = monotonic()
    with thief.joined(rig.rig.bus.host, ports(rig)[1]) as session:
        while seen.newest(Applied).refused == before:
            assert monotonic() < begun + 10.0
            session.put(key(RIG, COMMAND), encode(replace(seen.newest(Command), owner=1)))
            sleep(PAUSE_S)
    assert rig.job(held)["state"] == "running"


@pytest.mark.parametrize("supervised", [True, False], ids=["over REST", "past the supervisor"])
def test_an_emergency_stop_of_an_operator_takes_effect(
    rig: RunningRig, seen: Witness, folder: Folder, held: str, supervised: bool
) -> None:
    begun = monotonic()
    if supervised:
        rig.post(f"/rigs/{RIG}/estop").raise_for_status()
    else:
        output = pincette("estop", "--rig", operators_file(rig, folder), "--url", NOBODY)
        assert output.returncode == 0, output.stderr
        # Neither way needs the supervisor; on a busy machine the second confirms first.
        assert re.search(f"rig {RIG}: stopped (at the actuator|through the router)", output.stdout)
    _, tripped = seen.until_state(("frozen", "ramping", "latched"), begun)
    assert tripped.cause.startswith("estop")
    assert rig.ended(held)["state"] in ENDS
    seen.until_state(("latched",), begun)
    reset(rig)


def operators_file(rig: RunningRig, folder: Folder) -> Path:
    """Return the rig file of an operator."""
    path = rig.path.with_name("operator.toml")
    lines = f'[bus]\npki = "{folder.path}"\nidentity = "operator"'
    path.write_text(rig.path.read_text(encoding="utf-8").replace("[bus]", lines), encoding="utf-8")
    return path
