"""A program proposes jobs with its key, and a person approves them, at a rig of real processes."""

from collections.abc import Generator
from time import monotonic, sleep

import pytest

from pincette.api.access import Scope
from pincette.client import NotPermittedError, Supervisor
from pincette_supervisor.access.key_store import open_keys
from tests.support.commands import pincette
from tests.support.grips import SHORT, kill, make_ready, restart
from tests.support.keys import shown
from tests.support.rigs import demo_rig
from tests.support.running import RunningRig, running_rig

LONG_S = 180.0
"""Longest time of a job, in s; a rig in lockstep is as slow as the machine is loaded."""
KNOWN_S = 60.0
"""Longest time until a running supervisor knows a new key, or has written its audit log."""
USERS: dict[str, Scope] = {"agent": "propose", "ann": "operate", "boss": "admin"}


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    folder = tmp_path_factory.mktemp("rig")
    with running_rig(demo_rig(SHORT, time="lockstep"), folder) as up:
        make_ready(up, LONG_S)
        # An actuator that was never armed is unknown to a restarted supervisor.
        assert up.ended(up.start_grip(), LONG_S)["state"] == "succeeded"
        yield up


@pytest.fixture(scope="module")
def keys(rig: RunningRig) -> dict[str, str]:
    """Create a key for each user; return when the supervisor, which reads the keys at intervals,
    requires one and accepts the newest one.
    """
    with open_keys(rig.data) as book:
        made = {name: book.add(name, scope, None)[0] for name, scope in USERS.items()}
    began_s = monotonic()
    boss = shown(made["boss"])
    while [rig.client.get("/rigs", headers=key).status_code for key in ({}, boss)] != [401, 200]:
        assert monotonic() - began_s < KNOWN_S
        sleep(0.05)
    rig.client.headers.update(boss)
    return made


def until_audited(boss: Supervisor, who: str, detail: str) -> None:
    """Wait until the audit log has an entry, which is written with some delay."""
    began_s = monotonic()
    while (who, detail) not in [(entry.who, entry.detail) for entry in boss.audit(50)]:
        assert monotonic() - began_s < KNOWN_S, (who, detail)
        sleep(0.1)


def test_a_job_proposed_by_a_program_runs_once_a_person_approves_it(
    rig: RunningRig, keys: dict[str, str]
) -> None:
    url = rig.rig.supervisor.url
    with (
        Supervisor(url, key=keys["agent"]) as agent,
        Supervisor(url, key=keys["boss"]) as boss,
    ):
        own = agent.rig("demo")
        assert own.plan("grip").feasible
        with pytest.raises(NotPermittedError):
            own.start("grip")
        job = own.start("grip", approval_s=3600.0)
        assert job.state == "proposed"
        with pytest.raises(NotPermittedError):
            job.act("approve")

        until_audited(boss, "agent", f"propose grip {job.id}")
        kill(rig, "supervisor")
        restart(rig, "supervisor")
        where = ("--url", url, "--key", keys["ann"])
        listed = pincette("job", "list", "--state", "proposed", *where, timeout_s=LONG_S)
        assert job.id in listed.stdout
        done = pincette("job", "approve", job.id, *where, timeout_s=LONG_S)
        assert done.returncode == 0, done.stderr
        ended = job.wait(LONG_S)
        assert ended.state == "succeeded", ended.cause
        assert (ended.by, [one.by for one in ended.actions]) == ("agent", ["ann"])

        until_audited(boss, "ann", "approve, proposed by agent")


def test_after_a_rejected_or_expired_proposal_nothing_moves(
    rig: RunningRig, keys: dict[str, str]
) -> None:
    url = rig.rig.supervisor.url
    with Supervisor(url, key=keys["agent"]) as agent:
        own = agent.rig("demo")
        rejected, late = own.start("grip", approval_s=600.0), own.start("grip", approval_s=0.1)
        where = ("--url", url, "--key", keys["ann"])
        done = pincette("job", "reject", rejected.id, *where, timeout_s=LONG_S)
        assert done.returncode == 0, done.stderr
        for job, code in ((rejected, "rejected"), (late, "proposal_expired")):
            ended = job.wait(LONG_S)
            assert ended.ending is not None
            assert (ended.state, ended.ending.code) == ("stopped", code)
            assert ended.started_at is None
