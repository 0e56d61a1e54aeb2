"""Pictures that are drawn in a separate process."""

import logging
import os
from collections.abc import Callable, Iterator
from typing import TypeVar

import pytest

from pincette.config import RigFile
from pincette_supervisor.planning.worker import Worker
from pincette_supervisor.results.archive import picture

from .harness import Harness

pytestmark = pytest.mark.usefixtures("drawn")
A = TypeVar("A")
R = TypeVar("R")


@pytest.fixture(scope="module")
def artist() -> Iterator[Worker]:
    worker = Worker(picture)
    yield worker
    worker.close()


def pixels(drawn: object) -> object:
    """Return what two drawings of one subject have in common; vector files contain dates and
    numbers."""
    return getattr(drawn, "png", drawn)


def test_records_and_trajectories_are_drawn_the_same_in_both_processes(
    open_harness: Callable[..., Harness],
    rig_file: RigFile,
    artist: Worker,
    caplog: pytest.LogCaptureFixture,
) -> None:
    pairs: list[tuple[object, object]] = []

    def draw(work: Callable[[A], R], argument: A, /) -> R:
        there = artist.run_somewhere(work, argument)
        pairs.append((pixels(work(argument)), pixels(there)))
        return there

    harness = open_harness(rig_file, draw=draw)
    harness.ended(harness.grip()["id"])
    harness.calibrated("noise")
    stored = harness.post("/trajectories", {"kind": "grip", "force_mN": 8.0}).json()
    plot = harness.call("GET", f"/api/v1/trajectories/{stored['digest']}/plot")
    assert plot.content.startswith(b"\x89PNG")
    assert artist.pid not in (0, os.getpid())
    assert len(pairs) == 3
    assert all(here == there for here, there in pairs)
    assert not [one for one in caplog.records if one.levelno >= logging.ERROR]


def test_a_record_is_complete_if_the_drawing_process_fails(
    open_harness: Callable[..., Harness], rig_file: RigFile, caplog: pytest.LogCaptureFixture
) -> None:
    class Broken(Worker):
        def run(self, work: Callable[[A], R], argument: A) -> R:
            raise OSError(f"no room for {work} and {argument}")

    harness = open_harness(rig_file, draw=Broken().run_somewhere)
    job = harness.ended(harness.grip()["id"])
    names = [one["name"] for one in harness.get(f"/jobs/{job['id']}/artifacts")["artifacts"]]
    assert {"grip.png", "grip.svg", "grip.pdf", "manifest.json"} <= set(names)
    assert job["cause"] == ""
    assert "no room for" in caplog.text
