"""Forces that are requested one after another, and stops in each phase, with every adapter."""

import json
import subprocess
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
from anyio.from_thread import start_blocking_portal
from bluesky.utils import FailedStatus
from mcp import Client

from contrib.support.agent import server_of
from contrib.support.npm import DRIVE, NODE_WOT, npm_folder
from contrib.support.reaching import (
    NEAR_MN,
    SLOW,
    STOPS,
    Driver,
    NotReachedError,
    climb,
    stop_and_ask_again,
)
from contrib.support.run_engine import bps, closed, connected, ended, new_engine
from pincette.cli import Exit
from tests.support.adapters import WAIT_S, until
from tests.support.browser import Visit, looked_at, open_browser
from tests.support.commands import PINCETTE, pincette
from tests.support.running import Json, RunningRig

REACH = DRIVE.with_name("reach.js")
CHANGES = SLOW


class Rest:
    """REST only: a grip, or a hold of the part that is held already."""

    def __init__(self, rig: RunningRig) -> None:
        self.rig = rig

    @property
    def kind(self) -> str:
        return "hold" if self.rig.view()["part"] == "held" else "grip"

    def kept(self, force_mN: float) -> float | None:
        """Force of a part that is held already; None if no part is held."""
        if (job := self.rig.view()["active_job"]) is None:
            return None
        now = self.rig.job(job)["progress"]
        reached = max(abs(now[name] - force_mN) for name in ("force_r_mN", "force_mN")) < NEAR_MN
        return now["force_mN"] if reached else None

    def reach(self, force_mN: float) -> float:
        if (kept_mN := self.kept(force_mN)) is not None:
            return kept_mN
        return held_by(self.rig, self.started(force_mN))

    def started(self, force_mN: float) -> str:
        """Start the job; return its id."""
        answer = self.rig.post(
            "/jobs",
            {"kind": self.kind, "force_mN": force_mN, "until_released": True, "autostart": True},
        )
        assert answer.status_code == 201, answer.text
        return answer.json()["id"]

    def let_go(self, job: str) -> None:
        """Request the release of the part of a job."""
        self.rig.post(f"/jobs/{job}/actions", {"type": "release"}).raise_for_status()

    def release(self) -> None:
        job = self.rig.view()["active_job"]
        self.let_go(job)

        def ended() -> bool:
            if self.rig.job(job)["actions"][-1]["type"] == "stop":
                raise NotReachedError("the release was stopped")
            return self.rig.view()["active_job"] is None

        until(ended, "the part is not released")


class Typed(Rest):
    """The command line; ``watch`` follows each job."""

    def __init__(self, rig: RunningRig, following: ExitStack) -> None:
        super().__init__(rig)
        self.following, self.where = following, ("--url", rig.rig.supervisor.url)

    def reach(self, force_mN: float) -> float:
        try:
            return super().reach(force_mN)
        except NotReachedError as error:
            output, _ = self.watch.communicate(timeout=WAIT_S)
            assert self.watch.returncode == Exit.FAILED, output
            raise NotReachedError(output) from error

    def started(self, force_mN: float) -> str:
        words = ("--force-mN", str(force_mN), "--until-released", "--no-wait")
        job = self.typed(self.kind, *words).strip()
        line = [*PINCETTE, "watch", job, *self.where]
        self.watch = self.following.enter_context(
            subprocess.Popen(line, stdout=subprocess.PIPE, text=True)
        )
        self.following.callback(self.watch.kill)
        return job

    def let_go(self, job: str) -> None:
        self.typed("release", job, "--no-wait")

    def typed(self, *words: str) -> str:
        done = pincette("job", *words, *self.where)
        assert done.returncode == 0, done.stderr
        return done.stdout


class Page(Rest):
    """The page of the rig, in a browser."""

    def __init__(self, rig: RunningRig, seen: Visit) -> None:
        super().__init__(rig)
        self.seen = seen

    def reach(self, force_mN: float) -> float:
        try:
            return super().reach(force_mN)
        except NotReachedError:
            self.seen.until("#current-state", "stopped")
            raise

    def started(self, force_mN: float) -> str:
        page, before = self.seen.page, self.newest
        page.select_option("#kind", self.kind)
        page.fill("#field-force_mN", f"{force_mN:g}")
        if self.kind == "grip":
            page.check("#field-until_released")
        page.click("#start")
        self.seen.until_true(lambda: self.newest != before, "no job came", WAIT_S)
        return self.newest

    def let_go(self, job: str) -> None:
        before = self.releases(job)
        self.seen.page.click("#act-release", timeout=1000.0 * WAIT_S)
        requested = "the page has asked for no release"
        self.seen.until_true(lambda: self.releases(job) > before, requested)

    def releases(self, job: str) -> int:
        """Number of releases that were requested from a job."""
        return sum(action["type"] == "release" for action in self.rig.job(job)["actions"])

    @property
    def newest(self) -> str:
        """Id of the newest job; empty if there is none yet."""
        return next((job["id"] for job in self.rig.get("/jobs", limit=1)["jobs"]), "")


class Things(Rest):
    """The stock client of the Web of Things, which uses only the Thing Description."""

    def __init__(self, rig: RunningRig, process: "subprocess.Popen[str]") -> None:
        super().__init__(rig)
        self.process = process

    def reach(self, force_mN: float) -> float:
        kept_mN = self.kept(force_mN)
        return self.told(reach=force_mN)["held"] if kept_mN is None else kept_mN

    def release(self) -> None:
        assert self.told(release=True)["part"] == "none"

    def told(self, **asked: Any) -> Json:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps(asked) + "\n")
        self.process.stdin.flush()
        answer: Json = json.loads(self.process.stdout.readline())
        if "error" in answer:
            raise NotReachedError(answer["error"])
        return answer


def held_by(rig: RunningRig, job: str) -> float:
    """Settled force that a job holds; raises NotReachedError if the job has ended."""
    found: Json = {}

    def settled() -> bool:
        found.update(rig.job(job))
        now: Json | None = found["progress"]
        return found["ended_at"] is not None or (
            now is not None and now["force_held_mN"] is not None
        )

    until(settled, "the force does not settle")
    if found["state"] != "running":
        raise NotReachedError(f"{found['state']}: {found['cause']}")
    return found["progress"]["force_held_mN"]


@pytest.fixture(scope="module")
def wot_client(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return npm_folder(tmp_path_factory.mktemp("node"), REACH, *NODE_WOT)


@contextmanager
def bluesky(rig: RunningRig, _: pytest.FixtureRequest) -> Generator[Driver]:
    engine: Any = new_engine()
    gripper = connected(rig.rig.supervisor.url)

    class Plans:
        def reach(self, force_mN: float) -> float:
            try:
                engine(bps.mv(gripper, force_mN))
            except FailedStatus as error:
                raise NotReachedError(str(error.__cause__)) from error
            return rig.view()["newest"]["force_mN"]

        def release(self) -> None:
            try:
                engine(bps.mv(gripper, 0.0))
            except FailedStatus as error:
                raise NotReachedError(str(error.__cause__)) from error

    try:
        yield Plans()
    finally:
        closed(engine, gripper)
        ended(engine)


@contextmanager
def agent(rig: RunningRig, _: pytest.FixtureRequest) -> Generator[Driver]:
    server = server_of(rig.rig.supervisor.url, "--move")
    with (
        start_blocking_portal() as portal,
        portal.wrap_async_context_manager(Client(server)) as client,
    ):

        def call(tool: str, **arguments: Any) -> Any:
            answer = portal.call(client.call_tool, tool, arguments)
            if answer.is_error:
                raise NotReachedError(getattr(answer.content[0], "text", ""))
            return answer.structured_content

        class Tools:
            def reach(self, force_mN: float) -> float:
                plan = call("plan_grip", force_mN=force_mN)
                assert plan["token"], plan
                held = call("grip", token=plan["token"])
                assert held["outcome"] == "held"
                return held["force_held_mN"]

            def release(self) -> None:
                assert call("release")["part"] == "none"

        yield Tools()


@contextmanager
def rest(rig: RunningRig, _: pytest.FixtureRequest) -> Generator[Driver]:
    yield Rest(rig)


@contextmanager
def typed(rig: RunningRig, _: pytest.FixtureRequest) -> Generator[Driver]:
    with ExitStack() as following:
        yield Typed(rig, following)


@contextmanager
def page(rig: RunningRig, _: pytest.FixtureRequest) -> Generator[Driver]:
    with open_browser() as browser, looked_at(browser, rig.rig) as seen:
        seen.until("#fact-start", "can start")
        yield Page(rig, seen)


@contextmanager
def things(rig: RunningRig, request: pytest.FixtureRequest) -> Generator[Driver]:
    url = f"{rig.rig.supervisor.url}/.well-known/wot"
    with subprocess.Popen(
        ["node", REACH.name, url],
        cwd=request.getfixturevalue("wot_client"),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        yield Things(rig, process)


Adapter = Callable[[RunningRig, pytest.FixtureRequest], AbstractContextManager[Driver]]
ADAPTERS: tuple[Adapter, ...] = (rest, bluesky, agent)
OTHERS: tuple[Adapter, ...] = (typed, page, things)


@pytest.mark.parametrize("adapter", [*ADAPTERS, *OTHERS])
def test_forces_are_reached_one_after_another_without_a_release(
    rig: RunningRig, adapter: Adapter, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    with adapter(rig, request) as driver:
        climb(rig, driver, tmp_path)


@pytest.mark.parametrize("phase", STOPS)
@pytest.mark.parametrize("adapter", ADAPTERS)
def test_a_force_is_reached_after_a_stop_in_each_phase(
    rig: RunningRig, adapter: Adapter, request: pytest.FixtureRequest, phase: str
) -> None:
    with adapter(rig, request) as driver:
        stop_and_ask_again(rig, driver, phase)


@pytest.mark.parametrize("phase", STOPS)
@pytest.mark.parametrize("adapter", OTHERS)
def test_a_force_is_reached_after_a_stop_from_cli_page_or_web_of_things(
    rig: RunningRig, adapter: Adapter, request: pytest.FixtureRequest, phase: str
) -> None:
    with adapter(rig, request) as driver:
        stop_and_ask_again(rig, driver, phase)
