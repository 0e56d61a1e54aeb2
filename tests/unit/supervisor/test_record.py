"""A record states the meaning of its numbers, and contains its picture."""

import gc
import hashlib
import json
import struct
from pathlib import Path
from typing import Any

import pyarrow.parquet
import pytest
from matplotlib.backends import backend_agg

from pincette.api.requests import JobRequest
from pincette.config import RigFile
from pincette.core.messages import Recorded
from pincette.records import folder
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.kinds.track import TrackJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin.drawing import HEIGHT_PX, WIDTH_PX
from pincette_supervisor.results import archive

from . import samples

parquet: Any = pyarrow.parquet
JOB = JobRow("a", "grip", "demo", "running", {"kind": "grip"}, {}, "2026-03-01T12:00:00.000Z")
GRIP = GripJobRequest(kind="grip", force_mN=20.0)
TRACK = TrackJobRequest(kind="track", cycles=2)


def write(
    folder: Path,
    rig_file: RigFile,
    request: JobRequest = GRIP,
    ticks: list[samples.Tick] | None = None,
) -> archive.Record:
    ticks = samples.grip() if ticks is None else ticks
    messages = [m for tick in ticks for m in tick.messages()]
    planned = plan_job(request, rig_file)
    made = archive.gather(rig_file, JOB, planned, archive.Take(7, messages))
    made.write(folder)
    return made


def test_samples_state_units_and_their_job(tmp_path: Path, rig_file: RigFile) -> None:
    made = write(tmp_path, rig_file)
    whose = archive.about(made.run.planned, made.job, made.epoch)
    folder.write_samples(tmp_path / folder.SAMPLES, made.run.table, whose)
    table = parquet.read_table(tmp_path / folder.SAMPLES)
    assert table.schema.field("force_mN").metadata[b"unit"] == b"mN"
    assert table.schema.field("x_r_um").metadata == {
        b"unit": "µm".encode(),
        b"meaning": b"reference position, x_r",
    }
    assert all(field.metadata[b"meaning"] for field in table.schema)
    about = table.schema.metadata
    assert (about[b"job"], about[b"rig"], about[b"epoch"]) == (b"a", b"demo", b"7")
    assert table.column("x_um").to_pylist() == made.run.table["x_um"]
    assert table.num_rows == len(samples.grip())


def test_the_manifest_contains_the_checksum_of_every_file(
    tmp_path: Path, rig_file: RigFile
) -> None:
    write(tmp_path, rig_file)
    manifest = json.loads((tmp_path / folder.MANIFEST).read_text(encoding="utf-8"))
    files = {entry["name"]: entry["sha256"] for entry in manifest["files"]}
    assert set(files) == {
        "grip.png",
        "grip.svg",
        "grip.pdf",
        folder.REQUEST,
        folder.RESULT,
        folder.REPORT,
    }
    for name, digest in files.items():
        assert hashlib.sha256((tmp_path / name).read_bytes()).hexdigest() == digest
    assert {path.name for path in tmp_path.iterdir()} == {*files, folder.MANIFEST}


@pytest.mark.parametrize(
    ("recorded", "complete", "detail"),
    [
        (Recorded("a", 9, 0, complete=True, detail=""), True, ""),
        (Recorded("a", 9, 2, complete=False, detail="2 lost"), False, "2 lost"),
        ("no program answers recorder/finish", False, "no program answers recorder/finish"),
    ],
)
def test_the_manifest_states_whether_the_record_is_complete(
    tmp_path: Path, rig_file: RigFile, recorded: Recorded | str, complete: bool, detail: str
) -> None:
    write(tmp_path, rig_file).write(tmp_path, recorded)
    manifest = json.loads((tmp_path / folder.MANIFEST).read_text(encoding="utf-8"))
    assert (manifest["complete"], manifest["detail"]) == (complete, detail)


def test_the_manifest_lists_the_present_samples(tmp_path: Path, rig_file: RigFile) -> None:
    (tmp_path / folder.LIVE).write_bytes(b"samples")
    write(tmp_path, rig_file)
    manifest = json.loads((tmp_path / folder.MANIFEST).read_text(encoding="utf-8"))
    assert manifest["files"][0]["name"] == folder.LIVE


def test_the_result_can_be_read_back(tmp_path: Path, rig_file: RigFile) -> None:
    made = write(tmp_path, rig_file)
    assert json.loads((tmp_path / folder.RESULT).read_text(encoding="utf-8")) == made.tree


@pytest.mark.usefixtures("drawn")
@pytest.mark.parametrize(
    ("request_", "ticks", "name"),
    [
        (GRIP, samples.grip(), "grip.png"),
        (GRIP, [], "grip.png"),
        (TRACK, samples.track(), "track.png"),
        (TRACK, samples.grip()[:200], "track.png"),
        (TRACK, [], "track.png"),
    ],
    ids=["grip", "no grip", "track", "no track", "nothing"],
)
def test_the_picture_is_a_png_of_its_size(
    tmp_path: Path, rig_file: RigFile, request_: JobRequest, ticks: list[samples.Tick], name: str
) -> None:
    made = write(tmp_path, rig_file, request_, ticks)
    content = (tmp_path / name).read_bytes()
    assert content[:8] == b"\x89PNG\r\n\x1a\n"
    assert struct.unpack(">II", content[16:24]) == (WIDTH_PX, HEIGHT_PX)
    assert made.result.samples == len(ticks)


@pytest.mark.usefixtures("drawn")
def test_drawing_a_picture_leaks_no_memory(
    tmp_path: Path, rig_file: RigFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Left to the collector of cycles, each held 7 MB for some jobs."""
    surfaces: list[str] = []
    surface: Any = vars(backend_agg)["_RendererAgg"]

    class Counted(surface):
        def __init__(self, *size: Any) -> None:
            surface.__init__(self, *size)
            surfaces.append("made")

        def __del__(self) -> None:
            surfaces.append("freed")

    monkeypatch.setattr(backend_agg, "_RendererAgg", Counted)
    gc.disable()
    try:
        for _ in range(2):
            write(tmp_path, rig_file)
            assert surfaces
            assert surfaces.count("made") == surfaces.count("freed")
    finally:
        gc.enable()


def test_report_and_manifest_state_when_the_samples_were_recorded(
    tmp_path: Path, rig_file: RigFile
) -> None:
    made = write(tmp_path, rig_file)
    times = {
        "begin_at": "2026-03-01T14:00:00.000000Z",
        "sample_0_at": "2026-03-01T14:00:01.000000Z",
        "end_at": "2026-03-01T14:00:20.000000Z",
    }
    folder.write_samples(tmp_path / folder.SAMPLES, made.run.table, times)
    made.write(tmp_path)
    manifest = json.loads((tmp_path / folder.MANIFEST).read_text(encoding="utf-8"))
    assert {name: manifest[name] for name in times} == times
    page = (tmp_path / folder.REPORT).read_text(encoding="utf-8")
    assert f"recorded from {times['sample_0_at']} to {times['end_at']}" in page
    assert f"requested at {JOB.created_at}" in page
