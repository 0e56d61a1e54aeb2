"""The page for a person at the bench, and its files; it loads nothing from other servers."""

from base64 import b64encode
from collections.abc import Sequence
from datetime import datetime, time, timedelta
from functools import partial
from hashlib import sha256
from html import escape
from pathlib import Path
from typing import Annotated
from urllib.parse import urlsplit

from fastapi import APIRouter, Query, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse, HTMLResponse, Response

from pincette.core.number_tables import MOST_BYTES, FileError
from pincette.records import number_file
from pincette_supervisor import problems
from pincette_supervisor.rest.dependencies import OPERATE, AllRigs, Note, SupervisorId
from pincette_supervisor.rest.limits import read_body
from pincette_supervisor.rest.middleware import DRY_RUN
from pincette_supervisor.rest.strict_route import StrictRoute

FOLDER = Path(__file__).resolve().parents[1] / "web"
MEDIA_TYPES = {
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self'; connect-src 'self'; form-action 'self'; base-uri 'self'; "
    "frame-ancestors 'none'",
    "Cache-Control": "no-cache",
}
"""Further headers of the page: it and its files may load nothing from other servers."""
POLICY, PICTURES = "Content-Security-Policy", "img-src 'self'"
SCRIPTS = "script-src 'self'"
PLACE_OF_RIG, PLACE_OF_CAMERA, PLACE_OF_STOP = "{{rig}}", "{{camera}}", "{{stop}}"
PLACE_OF_SUPERVISOR = "{{supervisor}}"
DAYS = 31
STOP_SCRIPT = "js/stop.js"
"""Script of the emergency stop. It is part of the page itself, so that no other file is needed."""


router = APIRouter(include_in_schema=False, route_class=StrictRoute)


ASSETS = {
    path.relative_to(FOLDER).as_posix(): path
    for path in FOLDER.rglob("*")
    if path.suffix in MEDIA_TYPES
}
"""Files of the page by name; no other path is ever opened."""


@router.get("/")
def page(rigs: AllRigs, supervisor: SupervisorId, rig: str | None = None) -> HTMLResponse:
    """Return the page of a rig, with the rig's name and the script of the e-stop in it."""
    text = (FOLDER / "index.html").read_text(encoding="utf-8")
    stop = ASSETS[STOP_SCRIPT].read_text(encoding="utf-8")
    manager = rigs.own if rig is None else rigs.get(rig)
    name = escape(manager.name, quote=True)
    camera = manager.context.rig.supervisor.camera or ""
    text = text.replace(PLACE_OF_STOP, stop)
    text = text.replace(PLACE_OF_SUPERVISOR, supervisor)
    text = text.replace(PLACE_OF_RIG, name).replace(PLACE_OF_CAMERA, escape(camera, quote=True))
    return HTMLResponse(text, headers=_headers(stop, camera))


def _headers(stop: str, camera: str) -> dict[str, str]:
    """Return headers that also allow the script in the page and the pictures of the camera."""
    digest = b64encode(sha256(stop.encode()).digest()).decode()
    policy = HEADERS[POLICY].replace(SCRIPTS, f"{SCRIPTS} 'sha256-{digest}'")
    if camera:
        parts = urlsplit(camera)
        policy = policy.replace(PICTURES, f"{PICTURES} {parts.scheme}://{parts.netloc}")
    return {**HEADERS, POLICY: policy}


@router.get("/favicon.ico")
def icon() -> Response:
    """Return the icon that a browser requests without a reference in the page."""
    return asset("icon.svg")


@router.get("/page/days")
def days() -> dict[str, str | list[str]]:
    """Return this computer's time, its zone, and the midnights that began its last 31 days.

    The page uses them to find the jobs of a day, since the clock of a browser may be wrong.
    """
    now = datetime.now().astimezone()
    starts = [datetime.combine(now.date() - timedelta(days=ago), time()) for ago in range(DAYS)]
    return {
        "now": now.isoformat(timespec="seconds"),
        "zone": now.tzname() or "",
        "midnights": [start.astimezone().isoformat() for start in starts],
    }


@router.post("/page/points", dependencies=[OPERATE])
async def points(
    columns: Annotated[str, Query(max_length=200)], request: Request, rigs: AllRigs, note: Note
) -> list[dict[str, float]]:
    """Return the rows of a file of numbers, CSV or Parquet, for the points of a path."""
    note(DRY_RUN)
    content = await read_body(request, MOST_BYTES)
    # The unpacked content may be much larger than the file, so it is unpacked outside the
    # supervisor.
    read = partial(_rows, columns.split(","))
    found = await run_in_threadpool(rigs.own.context.draw, read, content)
    if isinstance(found, str):
        raise problems.unusable(found, pointer="/points")
    return found


def _rows(columns: Sequence[str], content: bytes) -> list[dict[str, float]] | str:
    """Return the rows of a file, or the reason why it has none."""
    try:
        return number_file.rows(content, columns, "the file")
    except FileError as error:
        return str(error)


@router.get("/page/{name:path}")
def asset(name: str) -> FileResponse:
    """Return a script, a style sheet or a drawing of the page."""
    path = ASSETS.get(name)
    if path is None:
        raise problems.not_found("file", name)
    return FileResponse(path, media_type=MEDIA_TYPES[path.suffix], headers=HEADERS)
