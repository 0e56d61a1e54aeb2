"""Every command of README.md is run in order, with the rig that `make up` starts."""

import re
import sys
from collections.abc import Generator
from pathlib import Path

import httpx
import pytest

from tests.support.checkout import (
    ROOT,
    await_text,
    demo_ports,
    run,
    until_interrupted,
    workspace,
)

README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```sh\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)
MAKE = [block.strip() for block in BLOCKS if block.startswith("make ")]
LISTENING = [block.strip() for block in BLOCKS if "subscribe.py" in block]
CONTAINERS = [block.strip() for block in BLOCKS if block.startswith("docker ")]
"""Commands that are run by tests/engine/test_brief.py."""
SHELL = [block for block in BLOCKS if block.strip() not in (*MAKE, *LISTENING, *CONTAINERS)]
BLOCK_S = 90.0
API = "http://127.0.0.1:8000/api/v1"

SAYS = {
    "pincette doctor": "in use by this rig itself",
    "plan grip": "feasible",
    "job grip --force-mN 15": "succeeded: gripped",
    "wait=terminal": '"state":"succeeded"',
    "pincette estop": "reset; the cause was: estop",
}
"""Expected output of blocks that contain these commands."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return workspace(tmp_path_factory.mktemp("readme") / "pincette")


@pytest.fixture(scope="module")
def made_up(folder: Path) -> Generator[None]:
    """Run `make up` and yield the running rig."""
    log = folder / "up.log"
    with demo_ports():
        with until_interrupted(["make", "up"], folder, log) as process:
            await_text(log, "is up at http://127.0.0.1:8000", process, 60.0)
            yield
        assert "every program has ended" in log.read_text(encoding="utf-8")


def test_every_command_of_the_readme_is_tested() -> None:
    assert MAKE == ["make demo", "make test", "make up"]
    assert LISTENING == ["python docs/examples/subscribe.py"]
    assert len(CONTAINERS) == 1
    unread = [text for text in SAYS if not any(text in block for block in SHELL)]
    assert unread == []
    assert all(any(text in block for text in SAYS) for block in SHELL)


def test_make_test_runs() -> None:
    pytest.skip("`make test` already runs this test")


def test_make_demo_runs(folder: Path) -> None:
    with demo_ports():
        done = run(["make", "demo"], folder, 170.0)
    assert done.returncode == 0, done.stdout
    for wanted in (
        r"job \S+ succeeded: gripped",
        r"contact stiffness +\d\.\d+ mN/µm",
        r"force held +\d+\.\d+ mN ± \d+\.\d+ mN",
        r"requested force +20\.00 mN",
        r"peak force +\d+\.\d+ mN",
        r"zero return +-?\d+\.\d+ mN ± \d+\.\d+ mN",
        r"record +data/jobs/\S+",
    ):
        assert re.search(rf"^{wanted}", done.stdout, re.MULTILINE), f"{wanted}\n{done.stdout}"
    processes = re.findall(r"^● (\w+) +(\d+) ", done.stdout, re.MULTILINE)
    loop = {"sensor", "estimator", "controller", "actuator", "rig"}
    assert loop <= {name for name, _ in processes}
    # A slow start lists a program more than once.
    names, numbers = ({row[place] for row in processes} for place in (0, 1))
    assert len(names) == len(numbers) == len(set(processes))


@pytest.mark.usefixtures("made_up")
def test_every_block_of_the_readme_works_as_described(folder: Path) -> None:
    state = folder / "shell-state"
    state.touch()
    for block in SHELL:
        # A reader types all blocks into one shell, so its variables persist.
        script = f"set -eu\n. {state}\n{block}\nset | grep -E '^(API|JOB|PATH)=' > {state} || true"
        done = run(["bash", "-c", script], folder, BLOCK_S)
        answer = folder / "data/job.json"
        text = answer.read_text(encoding="utf-8")[:500] if answer.exists() else ""
        assert done.returncode == 0, f"{block}\n{done.stdout}\n{text}"
        for command, words in SAYS.items():
            if command in block:
                assert words in " ".join(done.stdout.split()), f"{block}\n{done.stdout}"
    assert (folder / "data/grip.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("made_up")
def test_another_tool_can_subscribe(folder: Path) -> None:
    log = folder / "subscribe.log"
    with (
        until_interrupted(f".venv/bin/{LISTENING[0]}".split(), folder, log) as process,
        httpx.Client(trust_env=False) as client,
    ):
        # In lockstep time passes only during a job, and nothing is published before.
        started = client.post(f"{API}/jobs", json={"kind": "grip", "autostart": True})
        assert started.is_success, started.text
        await_text(log, " mN\n", process, 20.0)
        output = await_text(log, " V\n", process, 20.0)
    assert re.search(r"^ *-?\d+\.\d{3} µm +-?\d+\.\d{3} mN\n", output, re.MULTILINE)
    assert re.search(r"^ *-?\d+\.\d{4} V\n", output, re.MULTILINE)


def test_the_subscriber_does_not_import_pincette() -> None:
    text = (ROOT / "docs/examples/subscribe.py").read_text(encoding="utf-8")
    imported = set(re.findall(r"^(?:import|from) (\w+)", text, re.MULTILINE))
    assert imported - sys.stdlib_module_names == {"msgpack", "zenoh"}
