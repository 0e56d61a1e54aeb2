"""Bad input is refused with what, value, unit, limit and what to do, and leaves nothing running."""

import socket
from pathlib import Path

import pytest

from pincette.config import RigFile
from tests.support.commands import assert_nothing_is_left, pincette, pincette_here
from tests.support.grips import make_ready
from tests.support.rigs import Tree, demo_rig, rig_toml
from tests.support.running import RunningRig

REQUESTS = {
    "wrong type": ('{"kind": "grip", "force_mN": "20"}', ["force_mN = '20' mN", "number"]),
    "unknown field": ('{"kind": "grip", "force": 20}', ["force is not a field"]),
    "unknown kind": ('{"kind": "squeeze"}', ["kind = 'squeeze'", "'grip'"]),
    "not a number": ('{"kind": "grip", "force_mN": NaN}', ["force_mN = nan mN", "finite"]),
    "endless": ('{"kind": "grip", "hold_s": Infinity}', ["hold_s = inf s", "finite"]),
    "below zero": ('{"kind": "grip", "force_mN": -1}', ["force_mN = -1", "must be above 0 mN"]),
    "too long": ('{"kind": "grip", "hold_s": 9999}', ["hold_s = 9999", "3600 s"]),
    "too strong": ('{"kind": "grip", "force_mN": 500}', ["force", "500", "limit 40 mN"]),
    "no object": ("[20]", ["list"]),
}


@pytest.fixture
def rig(paced: RunningRig) -> RunningRig:
    make_ready(paced)
    return paced


@pytest.mark.parametrize("case", REQUESTS)
def test_a_bad_request_is_refused(rig: RunningRig, case: str) -> None:
    body, words = REQUESTS[case]
    before = rig.get("/jobs")["jobs"]
    answer = rig.client.post("/jobs", content=body, headers={"content-type": "application/json"})
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert [word for word in words if word not in problem["detail"]] == []
    assert problem.get("errors") or problem.get("violations")
    assert rig.get("/jobs")["jobs"] == before
    assert rig.view()["can_start"]


def test_a_request_that_is_not_json_is_refused(rig: RunningRig) -> None:
    before = rig.get("/jobs")["jobs"]
    answer = rig.client.post("/jobs", content="{", headers={"content-type": "application/json"})
    assert answer.status_code == 400
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert problem["type"] == "urn:pincette:problem:bad-json"
    assert "at line 1, column 2: mend the body and send it again" in problem["detail"]
    assert rig.get("/jobs")["jobs"] == before
    assert rig.view()["can_start"]


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (("--force-mN", "abc"), 2, ["--force-mN", "'abc'", "mN"]),
        (("--force-mN", "nan"), 2, ["--force-mN", "'nan'", "mN"]),
        (("--force-mN", "500"), 5, ["force 500", "mN", "limit 40 mN"]),
        (("--force-mN", "-3"), 1, ["force_mN = -3.0 mN", "must be above 0 mN"]),
        (("--hold-s", "9999"), 1, ["hold_s = 9999.0 s", "3600 s"]),
        (("--strength", "20"), 2, ["No such option", "--strength"]),
    ],
)
def test_a_bad_word_is_refused(
    rig: RunningRig, arguments: tuple[str, ...], status: int, words: list[str]
) -> None:
    url = f"http://127.0.0.1:{rig.rig.supervisor.port}"
    before = rig.get("/jobs")["jobs"]
    done = pincette("job", "grip", "--url", url, *arguments)
    assert done.returncode == status
    assert "Traceback" not in done.stderr
    assert [word for word in words if word not in done.stderr] == []
    assert rig.get("/jobs")["jobs"] == before


def test_a_second_rig_on_the_same_file_is_refused(rig: RunningRig, tmp_path: Path) -> None:
    done = pincette_here("up", "--rig", rig.path, "--data", tmp_path)
    assert done.returncode == 1
    assert f"router: 127.0.0.1:{rig.rig.bus.port} is in use" in done.stderr
    assert "up already" in done.stderr
    assert rig.view()["can_start"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (None, ["No such file or directory", "--rig"]),
        ("[rig\n", ["is not TOML"]),
        ('[law]\nKp = 1.0\n[rig]\nname = "r"\n', ["law.Kp = 1.0", "no such gain"]),
        ("[bus]\nport = 80\n", ["bus.port = 80", "1024"]),
        ('[rig]\nname = "r"\nperiod_s = "fast"\n', ["rig.period_s = 'fast'", "number"]),
        ('[rig]\nname = "r"\nperiod_s = nan\n', ["rig.period_s = nan"]),
    ],
)
def test_a_bad_rig_file_is_refused(tmp_path: Path, change: str | None, words: list[str]) -> None:
    path = tmp_path / "bad.toml"
    if change is not None:
        path.write_text(change, encoding="utf-8")
    done = pincette_here("up", "--rig", path, "--data", tmp_path)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert [word for word in [str(path), *words] if word not in done.stderr] == []


def test_limits_that_cross_are_refused(tmp_path: Path) -> None:
    text = rig_toml(demo_rig()).replace("voltage_max_V = 4.0", "voltage_max_V = -2.0")
    path = tmp_path / "crossed.toml"
    path.write_text(text, encoding="utf-8")
    done = pincette_here("up", "--rig", path, "--data", tmp_path)
    assert done.returncode == 1
    assert "voltage_min_V = -1.0 V is not below voltage_max_V = -2.0 V" in done.stderr


def cannot_start(rig: RigFile, folder: Path) -> str:
    """What `pincette up` says of a rig that cannot start; nothing is left of it."""
    path = folder / "rig.toml"
    path.write_text(rig_toml(rig), encoding="utf-8")
    done = pincette("up", "--rig", path, "--data", folder / "data")
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert_nothing_is_left(rig, path)
    return done.stderr


def test_an_instrument_that_nobody_answers_for(tmp_path: Path) -> None:
    # A rig that is not simulated: nothing listens where its instruments should be. Whose program
    # is the first to give up is chance.
    rig = demo_rig().model_copy(update={"simulation": None})
    said = cannot_start(rig, tmp_path)
    urls = {"sensor": rig.sensor.url, "actuator": rig.output.url}
    named = [name for name in urls if f"{name} did not start" in said]
    assert named
    assert [url for name, url in urls.items() if (name in named) != (url in said)] == []
    assert "refused" in said


@pytest.mark.parametrize("program", ["router", "actuator", "supervisor"])
def test_a_busy_port(tmp_path: Path, program: str) -> None:
    rig = demo_rig()
    offset = {"router": 0, "actuator": 4, "supervisor": 7}[program]
    path = tmp_path / "rig.toml"
    path.write_text(rig_toml(rig), encoding="utf-8")
    with socket.create_server(("127.0.0.1", rig.bus.port + offset)):
        done = pincette("up", "--rig", path, "--data", tmp_path / "data")
    assert done.returncode == 1
    assert f"{program}: 127.0.0.1:{rig.bus.port + offset} is in use" in done.stderr
    assert_nothing_is_left(rig, path)


def test_no_supervisor() -> None:
    done = pincette_here("job", "grip", "--url", f"http://127.0.0.1:{demo_rig().bus.port}")
    assert done.returncode == 3
    assert "no supervisor answers at http://127.0.0.1:" in done.stderr
    assert "pincette up" in done.stderr


def test_a_job_that_is_not_there(rig: RunningRig) -> None:
    done = pincette("job", "stop", "no-job", "--url", f"http://127.0.0.1:{rig.rig.supervisor.port}")
    assert done.returncode == 1
    assert "no job 'no-job'" in done.stderr


def test_a_program_that_does_not_start_takes_the_others_with_it(tmp_path: Path) -> None:
    changes: Tree = {"sensor": {"driver": "no_such_sensor"}}
    said = cannot_start(demo_rig(changes), tmp_path)
    assert "no_such_sensor" in said
    assert "keyence_lkg" in said
