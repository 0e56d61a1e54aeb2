"""``pincette latency --of-rig``, and the output of ``pincette job show`` on a loop's
punctuality."""

import hashlib
import json
from pathlib import Path
from typing import Any

import httpx
import pytest

from pincette.api.jobs import Artifact, Job
from pincette.api.live import LoopTiming
from pincette.cli import Exit
from pincette.cli.main import main
from tests.unit.client import desk

from .conftest import At

NAME = desk.example(Job)["id"]
AT = ("--rig-name", "demo")


def test_the_timing_statistics_of_a_loop_are_printed(
    at: At, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = LoopTiming.model_validate(desk.example(LoopTiming))
    at(httpx.Response(200, json=settings.model_dump()))
    assert main(["latency", "--of-rig", *AT]) == Exit.DONE
    shown = capsys.readouterr().out
    assert [line.split() for line in shown.splitlines()[2:]] == [
        ["estimator", "lateness", "1000", "0.094", "0.310", "0.550", "0.720", "0"],
        ["estimator", "age", "1000", "0.094", "0.310", "0.550", "0.720"],
        ["estimator", "execution", "1000", "0.094", "0.310", "0.550", "0.720"],
    ]
    silent: dict[str, Any] = {"programs": [], "silent": {"sensor": "in lockstep there is no clock"}}
    at(httpx.Response(200, json=silent))
    assert main(["latency", "--of-rig", *AT]) == Exit.FAILED
    assert capsys.readouterr().out == "sensor: in lockstep there is no clock\n"
    content = settings.model_dump_json().encode()
    (tmp_path / "timing.json").write_bytes(content)
    sha256 = hashlib.sha256(content).hexdigest()
    file = desk.example(Artifact, name="timing.json", sha256=sha256)
    listed = httpx.Response(200, json={"artifacts": [file]})
    replies = [desk.job(record="data/j"), listed, listed, httpx.Response(200, content=content)]
    at(*replies)
    assert main(["job", "show", NAME]) == Exit.DONE
    assert "estimator   execution" in capsys.readouterr().out
    at(*replies[:2])
    assert main(["job", "show", NAME, "--json"]) == Exit.DONE
    assert json.loads(capsys.readouterr().out)["files"] == [file]
