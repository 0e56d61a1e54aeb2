"""MADSci's stock RestNodeClient drives the node of contrib/madsci, in a separate environment."""

import json
import os
import signal
import subprocess
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic, sleep
from typing import Any, get_args

import httpx
import pytest

from contrib.support.reaching import SLOW, STOPS, NotReachedError, climb, stop_and_ask_again
from contrib.support.stock_clients import block
from pincette.api.endings import EndingCode
from pincette.api.jobs import Job
from pincette.api.predictions import Violation
from pincette.api.problems import TYPE
from pincette.api.results import OutcomeCode
from pincette.client.errors import RAISED
from pincette.control.vocabulary import FaultCode, LimitedQuantity
from pincette.core.faults import Cause
from tests.support.adapters import (
    FORCE_MN,
    NEAR_MN,
    SecuredLaboratory,
    secured_laboratory,
    until,
)
from tests.support.checkout import ROOT
from tests.support.environments import environment, ran, wheel
from tests.support.grips import restart
from tests.support.model_examples import example_of
from tests.support.rigs import at_own_ports, free_ports
from tests.support.running import RunningRig, running_rig
from tests.support.two_arms import SHORT_PAIR, two_arm_rig

# It gets a separate environment, whose packages take some seconds to import.
pytestmark = pytest.mark.slow

CHANGES = SLOW
PINS = ROOT / "requirements/madsci.txt"
DRIVE = Path(__file__).with_name("madsci_drive.py")
ENDING: dict[str, Any] = {"code": "tripped", "trip": "", "faults": []}
FAULTS = [{"code": str(each), "values": {"limit_um": 2.0}, "text": "words"} for each in FaultCode]
VIOLATION = example_of(Violation).model_dump(mode="json")
PAGE_URL = "http://127.0.0.1:2000"
"""URL of the node in the program that the page shows."""


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Python of an environment with the pinned packages of the node and the pincette-client of
    this tree."""
    return environment(
        tmp_path_factory.mktemp("madsci") / "venv",
        str(PINS),
        str(wheel("shared")),
        str(wheel("contrib/madsci")),
    )


@contextmanager
def node(
    python: Path, folder: Path, supervisor: str, **settings: str
) -> Generator[tuple[str, "subprocess.Popen[bytes]"]]:
    """Address and process of a node that has started."""
    url = f"http://127.0.0.1:{free_ports(1)}/"
    own = {"NODE_URL": url, "NODE_SUPERVISOR_URL": supervisor, "HOME": str(folder), **settings}
    log = folder / "node.log"
    with log.open("wb") as sink:
        process = subprocess.Popen(
            [str(python), "-m", "pincette_madsci"],
            cwd=folder,
            env={**os.environ, **own},
            stdout=sink,
            stderr=subprocess.STDOUT,
        )
    try:
        await_answer(f"{url}state", process, log)
        yield url, process
    finally:
        process.terminate()
        process.wait(20.0)


def await_answer(url: str, process: "subprocess.Popen[bytes]", log: Path) -> None:
    deadline = monotonic() + 120.0
    while True:
        assert process.poll() is None, log.read_text(errors="replace")[-3000:]
        assert monotonic() < deadline, log.read_text(errors="replace")[-3000:]
        try:
            if httpx.get(url, trust_env=False).json().get("state"):
                return
        except (httpx.TransportError, ValueError):
            pass
        sleep(0.2)


def driven(python: Path, folder: Path, *words: str) -> Any:
    """Output of the stock client, which stores files in its working folder."""
    return json.loads(ran([str(python), str(DRIVE), *words], folder).splitlines()[-1])


def test_the_stock_client_can_grip_and_receives_refusals(
    rig: RunningRig, python: Path, tmp_path: Path
) -> None:
    supervisor, process = rig.rig.supervisor.url, rig.fleet.members["supervisor"].process.pid
    with node(python, tmp_path, supervisor) as (url, _):
        output = driven(python, tmp_path, url, "all", supervisor, str(FORCE_MN), str(process))
    assert output["actions"] == ["grip", "plan", "release"]
    assert output["plan"]["status"] == "succeeded"
    for refused in ("refused", "infeasible"):
        (error,) = output[refused]["errors"]
        assert error[0] == "limit-violation"
        assert "force 500.000 mN above the limit 40 mN" in error[1]
    held = output["grip"]
    assert held["status"] == "succeeded"
    assert abs(held["json"]["force_held_mN"] - FORCE_MN) < NEAR_MN
    assert output["part"] == "held"
    assert output["second"]["json"]["job"] == held["json"]["job"]
    for name in ("higher", "lower"):
        assert output[name]["status"] == "succeeded"
        assert rig.job(output[name]["json"]["job"])["kind"] == "hold"
    assert abs(output["higher"]["json"]["force_held_mN"] - FORCE_MN - 5.0) < NEAR_MN
    assert output["release"]["json"]["job"] == output["lower"]["json"]["job"]
    assert code_of(output["nothing"]) == "nothing-held"
    assert output["locked"] == "not_ready"
    assert code_of(output["requested"], "cancelled") in ("key-stopped", "cancelled")
    assert output["cancelled"]["locked"] is True
    assert output["cancelled"]["command"] is True
    assert code_of(output["cancelled"], "cancelled") == "cancelled"
    assert output["stopped"]["command"] is True
    assert code_of(output["stopped"]) == "rig-latched"
    assert output["ready"] is False
    assert "estop" in output["latched"]["errors"][0][1]
    assert output["latched"]["status"] == "not_ready"
    assert output["errored"] is False


def test_results_with_every_code_are_valid_for_madsci(python: Path, tmp_path: Path) -> None:
    jobs: list[dict[str, Any]] = [
        *({"state": "failed", "result": {"outcome": each}} for each in get_args(OutcomeCode)),
        *({"state": "failed", "ending": {**ENDING, "code": each}} for each in get_args(EndingCode)),
        *({"state": "failed", "ending": {**ENDING, "trip": str(each)}} for each in Cause),
        *({"state": "failed", "ending": {**ENDING, "faults": [fault]}} for fault in FAULTS),
    ]
    problems: list[dict[str, Any]] = [
        {"type": f"{TYPE}{code}", "violations": [{**VIOLATION, "quantity": quantity}]}
        for code, quantity in (
            *(("limit-violation", each) for each in get_args(LimitedQuantity)),
            *((code, "force") for code in RAISED),
        )
    ]
    given = [
        *({"job": example_of(Job, **each).model_dump(mode="json")} for each in jobs),
        *({"problem": each} for each in problems),
    ]
    codes = Path(__file__).with_name("madsci_codes.py")
    done = subprocess.run(
        [str(python), str(codes)],
        cwd=tmp_path,
        env={**os.environ, "HOME": str(tmp_path)},
        input=json.dumps(given),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    output = json.loads(done.stdout.splitlines()[-1])
    assert len(output) == len(given)
    for job, found in zip(jobs, output[: len(jobs)], strict=True):
        assert found["json"]["outcome"] == job.get("result", {}).get("outcome", "")
        ending = job.get("ending")
        assert ending is None or ending.items() <= found["json"]["ending"].items()
    for problem, found in zip(problems, output[len(jobs) :], strict=True):
        assert found["json"]["violations"] == problem["violations"]
        assert found["json"]["code"] == found["type"] == problem["type"].removeprefix(TYPE)


def code_of(action: dict[str, Any], status: str = "failed") -> str:
    assert action["status"] == status
    return action["errors"][0][0]


def test_the_example_program_of_the_documentation_page_completes_a_grip(
    rig: RunningRig, python: Path, tmp_path: Path
) -> None:
    page = block("docs/how-to/madsci.md", "RestNodeClient").text
    program = page.split("\n", 1)[1].rpartition("PYTHON")[0]
    with node(python, tmp_path, rig.rig.supervisor.url) as (url, _):
        assert program.count(PAGE_URL) == 1
        output = ran([str(python), "-c", program.replace(PAGE_URL, url.rstrip("/"))], tmp_path)
    assert output.count("SUCCEEDED") == 3, output
    assert rig.view()["part"] == "none"


class Actions:
    """Actions of a node, called by one client."""

    def __init__(self, client: "subprocess.Popen[str]") -> None:
        self.client = client

    def reach(self, force_mN: float) -> float:
        return self.done("grip", force_mN=force_mN)["force_held_mN"]

    def release(self) -> None:
        self.done("release")

    def done(self, action: str, **arguments: float) -> Any:
        assert self.client.stdin is not None
        assert self.client.stdout is not None
        self.client.stdin.write(json.dumps([action, arguments]) + "\n")
        self.client.stdin.flush()
        # The client also writes its log there.
        lines = (line for line in self.client.stdout if line.startswith('{"status"'))
        found = json.loads(next(lines))
        if found["status"] != "succeeded":
            raise NotReachedError(str(found["errors"]))
        return found["json"]


@pytest.fixture(scope="module")
def served(
    running: RunningRig, python: Path, tmp_path_factory: pytest.TempPathFactory
) -> Generator[Actions]:
    folder = tmp_path_factory.mktemp("node")
    with node(python, folder, running.rig.supervisor.url) as (url, _):
        line = [str(python), str(DRIVE), url, "each"]
        with subprocess.Popen(
            line, cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as client:
            yield Actions(client)


def test_forces_are_reached_one_after_another_without_a_release(
    rig: RunningRig, served: Actions, tmp_path: Path
) -> None:
    climb(rig, served, tmp_path)


@pytest.mark.parametrize("phase", STOPS)
def test_a_force_is_reached_after_a_stop_in_each_phase(
    rig: RunningRig, served: Actions, phase: str
) -> None:
    stop_and_ask_again(rig, served, phase)


def test_a_client_that_leaves_and_a_killed_node_leave_the_part_held_for_the_next_node(
    rig: RunningRig, python: Path, tmp_path: Path
) -> None:
    supervisor, wanted = rig.rig.supervisor.url, json.dumps({"force_mN": FORCE_MN})
    with node(python, tmp_path, supervisor) as (url, process):
        assert driven(python, tmp_path, url, "leave", "grip", wanted)["status"] == "running"
        until(lambda: rig.view()["part"] == "held", "the motion does not continue")
        job = rig.view()["active_job"]
        process.send_signal(signal.SIGKILL)
        process.wait(20.0)
    assert rig.view()["part"] == "held"
    with node(python, tmp_path, supervisor) as (url, _):
        state = httpx.get(f"{url}state", trust_env=False).json()
        assert (state["part"], state["job"]) == ("held", job)
        released = driven(python, tmp_path, url, "release", "{}")
    assert released["json"]["job"] == job
    assert rig.view()["part"] == "none"


def test_an_unreachable_supervisor_is_reported_and_a_restarted_one_can_release(
    rig: RunningRig, python: Path, tmp_path: Path
) -> None:
    with node(python, tmp_path, rig.rig.supervisor.url) as (url, _):
        driven(python, tmp_path, url, "grip", json.dumps({"force_mN": FORCE_MN}))
        rig.fleet.signal("supervisor", signal.SIGKILL)

        def state() -> str:
            return httpx.get(f"{url}state", trust_env=False).json()["state"]

        until(lambda: state() == "unknown", "the supervisor is still reported as reachable")
        # An admin command that raises an exception would make the node unusable.
        answer = driven(python, tmp_path, url, "admin", "safety_stop")
        assert answer == {"success": False, "errors": ["no-answer"]}
        answer = driven(python, tmp_path, url, "admin", "cancel")
        assert answer == {"success": True, "errors": []}, "no action is running"
        restart(rig, "supervisor")
        until(lambda: state() != "unknown", "the supervisor is still reported as unreachable")
        until(lambda: rig.view()["part"] == "held", "the part is not held")
        assert driven(python, tmp_path, url, "release", "{}")["status"] == "succeeded"
    assert rig.view()["part"] == "none"


@pytest.fixture
def pair(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    with running_rig(
        at_own_ports(two_arm_rig(SHORT_PAIR)), tmp_path_factory.mktemp("pair")
    ) as found:
        yield found


def test_both_arms_of_a_rig_grip_and_release(
    pair: RunningRig, python: Path, tmp_path: Path
) -> None:
    with node(python, tmp_path, pair.rig.supervisor.url) as (url, _):
        refused = driven(python, tmp_path, url, "grip", json.dumps({"force_mN": 500.0}))
        assert code_of(refused) == "limit-violation"
        assert "force 500.000 mN above the limit 40 mN" in refused["errors"][0][1]
        wanted = json.dumps({"force_mN": FORCE_MN})
        assert driven(python, tmp_path, url, "plan", wanted)["status"] == "succeeded"
        held = driven(python, tmp_path, url, "grip", wanted)
        assert abs(held["json"]["force_held_mN"] - FORCE_MN) < NEAR_MN

        def told() -> Any:
            return httpx.get(f"{url}state", trust_env=False).json()

        until(lambda: told().get("part") == "held", "the node does not report the part")
        state = told()
        assert state["force_mN"] == pytest.approx(FORCE_MN, abs=NEAR_MN)
        assert state["second_force_mN"] == pytest.approx(FORCE_MN, abs=NEAR_MN)
        assert pair.job(held["json"]["job"])["kind"] == "grip"
        assert driven(python, tmp_path, url, "release", "{}")["status"] == "succeeded"
    assert pair.view()["part"] == "none"


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Generator[SecuredLaboratory]:
    with secured_laboratory(tmp_path_factory.mktemp("laboratory")) as made:
        yield made


def test_a_node_serves_one_rig_with_the_permissions_of_its_key(
    lab: SecuredLaboratory, python: Path, tmp_path: Path
) -> None:
    trusting = {"NODE_RIG": "right", "NODE_SUPERVISOR_AUTHORITY": str(lab.authority)}
    wanted = json.dumps({"force_mN": FORCE_MN})
    own = {**trusting, "NODE_SUPERVISOR_KEY": lab.keys["observe"]}
    with node(python, tmp_path, lab.url, **own) as (url, _):
        assert code_of(driven(python, tmp_path, url, "grip", wanted)) == "scope-too-small"
    own = {**trusting, "NODE_SUPERVISOR_KEY": lab.keys["operate"]}
    with node(python, tmp_path, lab.url, **own) as (url, _):
        assert driven(python, tmp_path, url, "grip", wanted)["status"] == "succeeded"
        assert lab.holds("right")
        assert lab.view("left")["active_job"] is None
        assert driven(python, tmp_path, url, "release", "{}")["status"] == "succeeded"
