"""The page a person at the bench sees, and its files; nothing in it comes from elsewhere."""

from html import escape
from pathlib import Path

from fastapi import APIRouter
from fastapi.responses import FileResponse, HTMLResponse, RedirectResponse, Response

from pincette_supervisor import problems
from pincette_supervisor.running.rigs import Rigs

FOLDER = Path(__file__).resolve().parents[1] / "page"
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
PLACE_OF_RIG = "{{rig}}"


def routes(rigs: Rigs) -> APIRouter:
    """``/`` and everything under ``/page``."""
    router = APIRouter(include_in_schema=False)

    @router.get("/")
    def page(rig: str | None = None) -> HTMLResponse:  # pyright: ignore[reportUnusedFunction]
        """The page of a rig; its name stands in it, so that the e-stop needs no answer first."""
        text = (FOLDER / "index.html").read_text(encoding="utf-8")
        conductor = rigs.own if rig is None else rigs.get(rig)
        name = escape(conductor.name, quote=True)
        return HTMLResponse(text.replace(PLACE_OF_RIG, name), headers=HEADERS)

    @router.get("/favicon.ico")
    def icon() -> Response:  # pyright: ignore[reportUnusedFunction]
        """Where a browser looks for an icon by itself."""
        return RedirectResponse("/page/icon.svg", headers=HEADERS)

    @router.get("/page/{name}")
    def asset(name: str) -> FileResponse:  # pyright: ignore[reportUnusedFunction]
        """A script, a style or a drawing."""
        path = FOLDER / name
        if path.suffix not in MEDIA_TYPES or path.parent != FOLDER or not path.is_file():
            raise problems.not_found("file", name)
        return FileResponse(path, media_type=MEDIA_TYPES[path.suffix], headers=HEADERS)

    return router
