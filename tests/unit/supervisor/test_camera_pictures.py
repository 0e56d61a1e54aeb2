"""Pictures of the rig's camera at contact, hold and end of a job, in its record."""

import json
import threading
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import Any

import pytest

from pincette.config import RigFile
from pincette_supervisor.results.camera import CameraError, fetch, first_part
from tests.support.cameras import Sender, camera

from .harness import Harness

PICTURE = b"\xff\xd8\xff\xe1 thumbnail \xff\xd9 picture \xff\xd9"
MOMENTS = ("contact", "hold", "end")


def stream(handler: BaseHTTPRequestHandler) -> None:
    handler.send_response(200)
    handler.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
    handler.end_headers()
    for _ in range(3):
        handler.wfile.write(b"--frame\r\nContent-Type: image/jpeg\r\n\r\n" + PICTURE + b"\r\n")


def still(handler: BaseHTTPRequestHandler) -> None:
    handler.send_response(200)
    handler.send_header("Content-Type", "image/jpeg")
    handler.end_headers()
    handler.wfile.write(PICTURE)


def text(handler: BaseHTTPRequestHandler) -> None:
    handler.send_response(200)
    handler.send_header("Content-Type", "text/html")
    handler.end_headers()
    handler.wfile.write(b"<p>sign in")


def absent(handler: BaseHTTPRequestHandler) -> None:
    handler.send_error(404)


def recorded(rig_file: RigFile, folder: Path, address: str) -> tuple[dict[str, Any], Path]:
    """Return a grip with a camera once its record is written, and the folder of the record."""
    access = rig_file.supervisor.model_copy(update={"camera": address})
    harness = Harness(rig_file.model_copy(update={"supervisor": access}), folder)
    try:
        job = harness.ended(harness.grip()["id"])
        listed = harness.get(f"/jobs/{job['id']}/artifacts")["artifacts"]
    finally:
        harness.close()
    return {**job, "files": {one["name"]: one for one in listed}}, folder / "jobs" / job["id"]


@pytest.mark.parametrize("send", [stream, still])
def test_the_next_picture_of_a_stream_or_a_still_is_returned(send: Sender) -> None:
    with camera(send) as address:
        assert fetch(address) == PICTURE


def test_a_part_is_complete_at_its_length_or_at_the_next_boundary() -> None:
    head = b"--f\r\nContent-Type: image/jpeg\r\n"
    sized = head + f"Content-Length: {len(PICTURE)}\r\n\r\n".encode() + PICTURE
    assert first_part(sized, b"f") == PICTURE
    assert first_part(sized[:-1], b"f") == b""
    unsized = head + b"\r\n" + PICTURE
    assert first_part(unsized, b"f") == b""
    assert first_part(unsized + b"\r\n--f", b"f") == PICTURE
    assert first_part(unsized + b"\r\n--f", b"--f") == PICTURE


def test_a_page_is_no_picture() -> None:
    with camera(text) as address, pytest.raises(CameraError):
        fetch(address)


@pytest.mark.usefixtures("drawn")
def test_a_record_has_the_pictures_of_contact_hold_and_end(
    rig_file: RigFile, tmp_path: Path
) -> None:
    with camera(stream) as address:
        job, folder = recorded(rig_file, tmp_path, address)
    assert job["state"] == "succeeded"
    for moment in MOMENTS:
        entry = job["files"][f"camera-{moment}.jpg"]
        assert (entry["media_type"], entry["bytes"]) == ("image/jpeg", len(PICTURE))
        assert (folder / entry["name"]).read_bytes() == PICTURE
    notes = json.loads((folder / "camera.json").read_bytes())
    assert tuple(notes) == MOMENTS
    for note in notes.values():
        assert note["taken_at"] >= note["requested_at"]
        assert note["trouble"] == ""


@pytest.mark.usefixtures("drawn")
def test_a_failed_camera_costs_a_note(rig_file: RigFile, tmp_path: Path) -> None:
    with camera(absent) as address:
        job, folder = recorded(rig_file, tmp_path, address)
    assert (job["state"], job["cause"], job["artifacts"]) == ("succeeded", "", "ready")
    assert not [name for name in job["files"] if name.endswith(".jpg")]
    notes = json.loads((folder / "camera.json").read_bytes())
    assert tuple(notes) == MOMENTS
    assert all(note["trouble"] and note["taken_at"] is None for note in notes.values())


@pytest.mark.usefixtures("drawn")
def test_a_camera_that_never_sends_delays_no_end_of_a_job(
    rig_file: RigFile, tmp_path: Path
) -> None:
    over = threading.Event()

    def never(_: BaseHTTPRequestHandler) -> None:
        over.wait(60.0)

    with camera(never) as address:
        access = rig_file.supervisor.model_copy(update={"camera": address})
        harness = Harness(rig_file.model_copy(update={"supervisor": access}), tmp_path)
        try:
            name = harness.grip()["id"]
            harness.live.done.wait(60.0)
            # The job has ended, and its pictures are still awaited.
            assert not (tmp_path / "jobs" / name / "camera.json").exists()
            job = harness.ended(name)
        finally:
            over.set()
            harness.close()
    assert (job["state"], job["cause"]) == ("succeeded", "")
    notes = json.loads((tmp_path / "jobs" / name / "camera.json").read_bytes())
    assert all(note["trouble"] for note in notes.values())
