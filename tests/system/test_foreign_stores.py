"""A rig with foreign stores on its bus: stops, resets, jobs and holds; and the topics that the
rig publishes."""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import json
from collections import Counter
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from time import monotonic, sleep

import httpx
import pytest

from pincette.bus.endpoints import tool_endpoint
from pincette.bus.zenoh_bus import ZenohBus
from pincette.config.reading import laid_over
from pincette.core.messages import GroundTruth, Position, Telemetry
from pincette.core.topics import (
    GROUND_TRUTH,
    LOOP,
    POSITION,
    TELEMETRY,
    TOPICS,
    While,
    keys_of,
    live_key,
)
from tests.support.commands import pincette
from tests.support.foreign import KINDS, declared, outsider
from tests.support.grips import SHORT, make_ready
from tests.support.rigs import demo_rig
from tests.support.routed import until
from tests.support.running import RunningRig, running_rig

STOP_S = 1.5
"""Longest time until a reply to a stop on a busy machine, in s."""
LEASE_S = 2.0
HELD_S = 4.0 * LEASE_S
"""A hold that ends earlier if the lease of its program is not renewed."""
LOOKED_S = 2.5
"""Time for which the published topics are recorded, in s: timing is published once a second."""
LEASED = laid_over(SHORT, {"safety": {"lease_s": LEASE_S}})
SILENT_S = 0.5
GHOSTS = tuple(f"ghost-{number}" for number in range(100))


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    with running_rig(demo_rig(LEASED), tmp_path_factory.mktemp("rig")) as running:
        yield running


@contextmanager
def beside(rig: RunningRig, kinds: tuple[str, ...], mode: str) -> Generator[None]:
    """Declare complete queryables of some kinds, each in a separate session."""
    place = f"tcp/{rig.rig.bus.host}:{rig.rig.bus.port}"
    with ExitStack() as stack:
        for kind in kinds:
            stamps = kind == "stamping store"
            session = stack.enter_context(outsider(mode, place, stamps=stamps))
            stack.enter_context(declared(session, kind))
        sleep(SILENT_S)
        yield


@pytest.mark.parametrize("mode", ["client", "peer", "router"])
def test_stop_reset_and_a_whole_job_succeed_despite_foreign_stores(
    rig: RunningRig, mode: str
) -> None:
    make_ready(rig)
    with beside(rig, KINDS, mode):
        job = rig.start_grip()
        assert rig.ended(job)["state"] == "succeeded"
        begun_s = monotonic()
        answer = rig.post("/rigs/demo/estop")
        assert monotonic() - begun_s < STOP_S
        assert answer.status_code == 200, answer.text
        assert rig.view()["latch"]["cause"] == "estop"
        make_ready(rig)
        assert not rig.view()["latch"]["cause"]


def test_a_hold_has_its_duration_despite_foreign_stores(rig: RunningRig) -> None:
    make_ready(rig)
    with beside(rig, KINDS, "peer"):
        job = rig.ended(rig.start_grip(hold_s=HELD_S))
        assert job["state"] == "succeeded", job["cause"]


class TestTokensOfOtherRigs:
    """Liveliness tokens of rigs that do not exist, or whose actuator does not reply."""

    @contextmanager
    def present(self, rig: RunningRig, hanging: tuple[str, ...] = ()) -> Generator[None]:
        place = f"tcp/{rig.rig.bus.host}:{rig.rig.bus.port}"
        with ExitStack() as stack:
            tool = stack.enter_context(outsider("client", place))
            for name in hanging:
                stack.enter_context(declared(tool, "silent", f"pincette/v2/{name}/call/**"))
            tokens = [
                tool.liveliness().declare_token(live_key(name, program))
                for name in (*GHOSTS, *hanging)
                for program in LOOP
            ]
            listed = {*GHOSTS, *hanging}
            until(lambda: listed <= unserved(rig))
            yield
            for token in tokens:
                token.undeclare()

    def test_foreign_tokens_leave_every_stop_confirmed(self, rig: RunningRig) -> None:
        make_ready(rig)
        with self.present(rig):
            begun_s = monotonic()
            answer = rig.post("/estop")
            assert monotonic() - begun_s < STOP_S
            assert answer.status_code == 200, answer.text
            assert [one["rig"] for one in answer.json()["rigs"]] == ["demo"]
            found = pincette("estop", "--rig", rig.path, "--json")
            assert found.returncode == 0, found.stdout + found.stderr
            assert json.loads(found.stdout)["unconfirmed"] == []

    def test_the_served_rig_is_stopped_despite_a_hanging_one(self, rig: RunningRig) -> None:
        make_ready(rig)
        with self.present(rig, ("hung-a", "hung-b")):
            for path, missed in (("/estop", ["hung-a", "hung-b"]), ("/rigs/demo/estop", None)):
                make_ready(rig)
                begun_s = monotonic()
                answer = rig.post(path)
                assert monotonic() - begun_s < 2.0 * STOP_S
                assert rig.view()["latch"]["cause"] == "estop"
                if missed is None:
                    assert answer.status_code == 200, answer.text
                else:
                    assert answer.status_code == 503
                    assert answer.json()["stopped"] == ["demo"]
                    assert sorted(answer.json()["unconfirmed"]) == missed, answer.text[-300:]

            def stopped_from_the_command_line() -> bool:  # within 3 s, which a busy machine exceeds
                found = pincette("estop", "--rig", rig.path, "--json")
                output = json.loads(found.stdout)
                assert found.returncode in (1, 3)
                assert (
                    {"hung-a", "hung-b"} <= {*output["unconfirmed"]} <= {"hung-a", "hung-b", "demo"}
                )
                return "demo" in output["stopped"]

            until(stopped_from_the_command_line, 60.0)


def unserved(rig: RunningRig) -> set[str]:
    """Return the names of rigs that the supervisor has found and does not serve."""
    reasons = httpx.get(f"{rig.rig.supervisor.url}/readyz").json()["reasons"]
    return {reason.partition(":")[0] for reason in reasons}


class TestWhatIsPublished:
    """Compared with the register of topics, from which the page of keys is generated."""

    def seen(self, rig: RunningRig, job: str = "") -> set[str]:
        """Return the keys on which messages arrive for some time, or until a job has ended."""
        counted: Counter[str] = Counter()
        place = f"tcp/{rig.rig.bus.host}:{rig.rig.bus.port}"
        with outsider("client", place) as session:
            everything = session.declare_subscriber(
                "pincette/**", lambda sample: counted.update([str(sample.key_expr)])
            )
            sleep(SILENT_S)
            counted.clear()
            if job:
                assert rig.ended(rig.start_grip())["state"] == job
            else:
                sleep(LOOKED_S)
            everything.undeclare()
        return set(counted)

    def compare(self, seen: set[str], state: While) -> None:
        registered = {place: topic for topic in TOPICS for place in keys_of("demo", topic).values()}
        assert seen <= {place for place, topic in registered.items() if state in topic.published}
        steady = {
            place
            for place, topic in registered.items()
            if state in topic.published and (topic.per_tick or topic.name == "timing")
        }
        assert steady <= seen

    def test_the_published_bus_keys_are_documented_in_every_state_of_the_rig(
        self, rig: RunningRig
    ) -> None:
        make_ready(rig)
        during = self.seen(rig, "succeeded")
        self.compare(during, "job")
        assert {f"pincette/v2/demo/request_log/{one}" for one in LOOP} <= during
        self.compare(self.seen(rig), "idle")
        rig.post("/rigs/demo/estop").raise_for_status()
        sleep(SILENT_S)
        self.compare(self.seen(rig), "latched")

    def test_after_a_job_the_keys_of_telemetry_and_ground_truth_are_documented(
        self, rig: RunningRig
    ) -> None:
        make_ready(rig)
        assert rig.ended(rig.start_grip())["state"] == "succeeded"
        bus = ZenohBus(tool_endpoint(rig.rig), "demo", "tool")
        telemetry, position = bus.latest(TELEMETRY), bus.latest(POSITION)
        first, second = bus.latest(GROUND_TRUTH), bus.latest(GROUND_TRUTH)
        bus.close()
        assert isinstance(telemetry, Telemetry)
        assert isinstance(position, Position)
        assert not telemetry.playing
        assert position.epoch == telemetry.epoch
        assert position.seq > telemetry.seq, "the sensor must continue after the program has ended"
        assert isinstance(first, GroundTruth)
        assert first == second, "no voltage may be written on an idle rig"
