"""Pictures of the configured camera at contact, hold and end of a job, as files of its record.

A separate thread fetches them. A camera that fails or is slow leaves a note in the record and
nothing else.
"""

import re
import ssl
from concurrent.futures import Executor, Future
from concurrent.futures import TimeoutError as LateError
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import monotonic
from typing import Literal

from pincette.core.files import make_folder
from pincette.records import folder as files
from pincette_supervisor.journal.store import utc_now

Moment = Literal["contact", "hold", "end"]
FETCH_S = 2.0
"""Longest time of one fetch; a picture that is requested while another fetch lasts is also late
after this time, in s."""
WRITE_S = 3.0
"""Longest time that the writing of a record waits for its pictures, in s."""
MOST_BYTES = 8_000_000
"""Largest picture."""
JPEG = b"\xff\xd8"
"""First bytes of a JPEG file."""
NOTES = "camera.json"
"""File with the times of the pictures, and the reasons for missing ones."""
LENGTH = re.compile(rb"content-length:[ \t]*(\d+)", re.IGNORECASE)


class CameraError(Exception):
    """A camera has sent no picture; the text states why."""


@dataclass(frozen=True, slots=True)
class Shot:
    """A picture, or the reason why there is none."""

    requested_at: str
    taken_at: str | None = None
    """Time at which the picture arrived; None without one."""
    trouble: str = ""


class CameraPictures:
    """Pictures of one job."""

    def __init__(self, address: str | None, executor: Executor) -> None:
        """Create the pictures; ``address`` None: there is no camera."""
        self._address, self._executor = address, executor
        self._shots: dict[Moment, tuple[Shot, Future[tuple[Shot, bytes]]]] = {}

    def take(self, moment: Moment) -> None:
        """Request a picture without waiting for it; only the first one of each moment."""
        if self._address is None or moment in self._shots:
            return
        shot, late_s = Shot(utc_now()), monotonic() + FETCH_S
        self._shots[moment] = shot, self._executor.submit(_shoot, self._address, shot, late_s)

    def write(self, folder: Path) -> None:
        """Write the pictures and their notes; raises OSError."""
        if not self._shots:
            return
        make_folder(folder)
        late_s, notes = monotonic() + WRITE_S, dict[str, dict[str, str | None]]()
        for moment, (asked, future) in list(self._shots.items()):
            try:
                shot, picture = future.result(max(0.0, late_s - monotonic()))
            except LateError:
                shot, picture = replace(asked, trouble=f"no picture within {WRITE_S:g} s"), b""
            if picture:
                files.write_bytes(folder / f"camera-{moment}.jpg", picture)
            notes[moment] = asdict(shot)
        files.write_json(folder / NOTES, notes)


def _shoot(address: str, shot: Shot, late_s: float) -> tuple[Shot, bytes]:
    import httpx  # not needed without a camera, and slow to import

    try:
        if monotonic() > late_s:
            raise CameraError(f"the camera was busy for {FETCH_S:g} s")
        picture = fetch(address)
    except (CameraError, httpx.HTTPError, httpx.InvalidURL, ValueError, OSError) as error:
        return replace(shot, trouble=str(error) or type(error).__name__), b""
    return replace(shot, taken_at=utc_now()), picture


def fetch(address: str) -> bytes:
    """Return the next picture of an MJPEG stream, or the picture at an address, as JPEG.

    Raises
    ------
    CameraError
        If there is none within ``FETCH_S``.
    httpx.HTTPError
        If the camera cannot be reached.
    """
    import httpx

    end_s, received = monotonic() + FETCH_S, bytearray()
    verify = ssl.create_default_context() if address.startswith("https:") else False
    with httpx.stream("GET", address, timeout=FETCH_S, verify=verify, trust_env=False) as response:
        response.raise_for_status()
        kind, _, options = response.headers.get("content-type", "").partition(";")
        boundary = options.partition("boundary=")[2].strip().strip('"').encode()
        for chunk in response.iter_raw():
            received += chunk
            if monotonic() > end_s:
                raise CameraError(f"no picture within {FETCH_S:g} s")
            if len(received) > MOST_BYTES:
                raise CameraError(f"the picture is larger than {MOST_BYTES / 1e6:g} MB")
            if boundary and (picture := first_part(bytes(received), boundary)):
                return _jpeg(picture)
    if kind.startswith("multipart/"):
        raise CameraError("the stream ended before its first picture")
    return _jpeg(bytes(received))


def first_part(received: bytes, boundary: bytes) -> bytes:
    """Return the content of the first part of a multipart stream; empty until it is complete."""
    head, blank, content = received.partition(b"\r\n\r\n")
    if not blank:
        return b""
    if (length := LENGTH.search(head)) is not None:
        size = int(length[1])
        return content[:size] if len(content) >= size else b""
    # Cameras write the boundary with or without the two dashes that the standard requires.
    part, found, _ = content.partition(b"\r\n--" + boundary.removeprefix(b"--"))
    return part if found else b""


def _jpeg(picture: bytes) -> bytes:
    if not picture.startswith(JPEG):
        raise CameraError("the camera sends no JPEG pictures")
    return picture
