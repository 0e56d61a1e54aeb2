"""The router is killed or hangs: a stop over REST uses the direct link to the actuator."""

import signal
from collections.abc import Generator
from contextlib import contextmanager
from time import monotonic, sleep

import pytest

from tests.support.certificates import folder_for
from tests.support.grips import kill, make_ready, restart
from tests.support.rigs import demo_rig
from tests.support.running import RunningRig, running_rig

REPLY_S, SLACK_S = 1.5, 1.0
"""Longest time until a reply to a stop, and the additional time on a busy machine."""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    own, folder = demo_rig(), tmp_path_factory.mktemp("rig")
    with running_rig(own.secured(folder_for(folder / "pki", own.rig.name).path), folder) as running:
        yield running


@contextmanager
def without_router(rig: RunningRig, number: signal.Signals) -> Generator[None]:
    if number == signal.SIGKILL:
        kill(rig, "router")
    else:
        rig.fleet.signal("router", number)
    try:
        yield
    finally:
        if number == signal.SIGKILL:
            restart(rig, "router")
        else:
            rig.fleet.signal("router", signal.SIGCONT)


@pytest.mark.parametrize(
    ("number", "path"),
    [(signal.SIGKILL, "/rigs/demo/estop"), (signal.SIGSTOP, "/estop")],
    ids=["killed", "hung"],
)
def test_a_stop_over_rest_reaches_the_actuator(
    rig: RunningRig, number: signal.Signals, path: str
) -> None:
    make_ready(rig)
    with without_router(rig, number):
        begun_s = monotonic()
        answer = rig.post(path)
        took_s = monotonic() - begun_s
        assert answer.status_code == 200, answer.text
        assert took_s < REPLY_S
    # The actuator itself has tripped.
    deadline = monotonic() + 20.0
    while rig.view()["latch"]["cause"] != "estop":
        assert monotonic() < deadline, rig.view()["latch"]
        sleep(0.1)


def test_an_unconfirmed_stop_is_answered_in_time(rig: RunningRig) -> None:
    with without_router(rig, signal.SIGSTOP):
        rig.fleet.signal("actuator", signal.SIGSTOP)
        try:
            for _ in range(3):
                begun_s = monotonic()
                answer = rig.post("/rigs/demo/estop")
                assert answer.status_code == 503
                assert answer.json()["type"].endswith("estop-unconfirmed")
                assert monotonic() - begun_s < REPLY_S + SLACK_S
        finally:
            rig.fleet.signal("actuator", signal.SIGCONT)
