"""The page a person at the bench sees, and its files; nothing in it comes from elsewhere."""

from html import escape
from pathlib import Path
from urllib.parse import urlsplit

from fastapi import APIRouter
from fastapi.responses import FileResponse, HTMLResponse, RedirectResponse, Response

from pincette_supervisor import problems
from pincette_supervisor.rest.dependencies import AllRigs
from pincette_supervisor.rest.strict_route import StrictRoute

FOLDER = Path(__file__).resolve().parents[1] / "web"
MEDIA_TYPES = {
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self'; connect-src 'self'; form-action 'self'; base-uri 'none'; "
    "frame-ancestors 'none'",
    "Cache-Control": "no-cache",
}
"""Beside those of every answer: the page and its files come from here, and nothing else does."""
POLICY, PICTURES = "Content-Security-Policy", "img-src 'self'"
PLACE_OF_RIG, PLACE_OF_CAMERA = "{{rig}}", "{{camera}}"


router = APIRouter(include_in_schema=False, route_class=StrictRoute)


ASSETS = {
    path.relative_to(FOLDER).as_posix(): path
    for path in FOLDER.rglob("*")
    if path.suffix in MEDIA_TYPES
}
"""Files of the page by name; no other path is ever opened."""


@router.get("/")
def page(rigs: AllRigs, rig: str | None = None) -> HTMLResponse:
    """The page of a rig; its name stands in it, so that the e-stop needs no answer first."""
    text = (FOLDER / "index.html").read_text(encoding="utf-8")
    manager = rigs.own if rig is None else rigs.get(rig)
    name = escape(manager.name, quote=True)
    camera = manager.context.rig.supervisor.camera or ""
    text = text.replace(PLACE_OF_RIG, name).replace(PLACE_OF_CAMERA, escape(camera, quote=True))
    return HTMLResponse(text, headers=_headers(camera))


def _headers(camera: str) -> dict[str, str]:
    """Pictures may come from the camera of the rig too, where there is one."""
    if not camera:
        return HEADERS
    parts = urlsplit(camera)
    allowed = f"{PICTURES} {parts.scheme}://{parts.netloc}"
    return {**HEADERS, POLICY: HEADERS[POLICY].replace(PICTURES, allowed)}


@router.get("/favicon.ico")
def icon() -> Response:
    """Where a browser looks for an icon by itself."""
    return RedirectResponse("/page/icon.svg", headers=HEADERS)


@router.get("/page/{name:path}")
def asset(name: str) -> FileResponse:
    """A script, a style or a drawing."""
    path = ASSETS.get(name)
    if path is None:
        raise problems.not_found("file", name)
    return FileResponse(path, media_type=MEDIA_TYPES[path.suffix], headers=HEADERS)
