"""``pincette demo`` ends what it has started only once the record is written."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Self

import pytest

from pincette import client
from pincette.cli import Exit, up
from pincette.cli.main import main

RIG = Path(__file__).parents[3] / "deploy/rigs/demo.toml"


class Handle:
    """A job that has ended, and whose record is still being written."""

    def __init__(self, log: list[str]) -> None:
        self._log = log
        self.job: Any = self._as("being_written")

    @staticmethod
    def _as(artifacts: str) -> SimpleNamespace:
        return SimpleNamespace(state="succeeded", result=None, artifacts=artifacts)

    def recorded(self) -> None:
        self._log.append("recorded")
        self.job = self._as("ready")


def test_the_record_is_waited_for_before_the_rig_goes_down(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log: list[str] = []
    shown: list[str] = []

    class Supervisor:
        def __init__(self, *_: Any, **__: Any) -> None: ...

        def __enter__(self) -> Self:
            return self

        def __exit__(self, *_: object) -> None: ...

        def rig(self, _name: str) -> SimpleNamespace:
            def start(_kind: str) -> Handle:
                return Handle(log)

            return SimpleNamespace(start=start)

    @contextmanager
    def running(*_: Any, **__: Any) -> Generator[None]:
        yield
        log.append("down")

    def follow(job: Handle, _console: Any) -> Any:
        return job.job

    def show(job: Any, _console: Any) -> None:
        shown.append(job.artifacts)

    monkeypatch.setattr(client, "Supervisor", Supervisor)
    monkeypatch.setattr(up, "running", running)
    monkeypatch.setattr(up, "show_result", show)
    monkeypatch.setattr(up, "follow", follow)
    assert main(["demo", "--rig", str(RIG), "--data", str(tmp_path)]) == Exit.DONE
    assert (log, shown) == (["recorded", "down"], ["ready"])
