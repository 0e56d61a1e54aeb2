"""The same programs on every kind of line: TCP, pseudo-terminals with byte timing, a byte
recording."""

from pathlib import Path
from typing import Any, cast

import pyarrow.parquet as parquet
import pytest

from pincette.config import parse_rig
from pincette.config.reading import laid_over
from tests.support.grips import whole_grip
from tests.support.rigs import Tree, demo_rig
from tests.support.running import Json, running_rig
from tests.support.witness import witness

pytestmark = pytest.mark.usefixtures("stalls")

NUMBERS = ["x_um", "force_mN", "voltage_V"]
DC205: Tree = {
    "driver": "srs_dc205",
    "options": {"range_V": 10, "address": None, "channel": None},
}
QUICK: Tree = {"grip": {"hold_s": 1.0, "load_s": 1.0}}


def test_a_grip_over_pseudo_terminals_with_real_transmission_times(tmp_path: Path) -> None:
    rig = demo_rig(
        {
            **QUICK,
            "sensor": {"url": str(tmp_path / "sensor"), "options": {"baud": 38400}},
            "output": {"url": str(tmp_path / "output"), **DC205},
        }
    )
    with (
        running_rig(rig, tmp_path) as running,
        witness(rig) as seen,
    ):
        job = whole_grip(running, seen)
    assert job["result"]["outcome"] == "gripped"


def recorded(folder: Path, job: Json) -> dict[str, list[Any]]:
    """Return position, force and voltage of a job."""
    path = folder / "data" / "jobs" / str(job["id"]) / "samples.parquet"
    table = cast(Any, parquet).read_table(path, columns=NUMBERS)
    return cast("dict[str, list[Any]]", table.to_pydict())


def test_a_recording_of_bytes_reproduces_the_job_without_instruments(tmp_path: Path) -> None:
    """Replayed through the same drivers and programs, each request must be the recorded one."""
    files = {table: tmp_path / f"{table}.dialogue" for table in ("sensor", "output")}
    keeping: Tree = {table: {"record": str(path)} for table, path in files.items()}
    rig = demo_rig(laid_over(QUICK, keeping), time="lockstep")
    live, later = tmp_path / "live", tmp_path / "later"
    live.mkdir()
    later.mkdir()
    with running_rig(rig, live) as running:
        first = running.ended(running.start_grip())
    tree = rig.model_dump(mode="json", exclude_unset=True)
    del tree["simulation"]
    for table, path in files.items():
        del tree[table]["record"]
        tree[table]["url"] = f"replay:{path}"
    with running_rig(parse_rig(tree), later) as running:
        again = running.ended(running.start_grip())
    assert first["state"] == again["state"] == "succeeded"
    assert len(recorded(live, first)["x_um"]) > 100
    assert recorded(later, again) == recorded(live, first)
