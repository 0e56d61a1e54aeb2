"""A real browser on the page of a rig; it records messages and requests of the page."""

import shutil
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic, sleep

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, ViewportSize, sync_playwright

from pincette.config import RigFile

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
DESK = {"width": 1280, "height": 800}
TABLETS = ({"width": 1024, "height": 768}, {"width": 768, "height": 1024})


@dataclass
class Visit:
    """A page, its log, and every address that it requested."""

    page: Page
    origin: str
    errors: list[str] = field(default_factory=list[str])
    addresses: list[str] = field(default_factory=list[str])

    def text(self, place: str) -> str:
        """Return the text of an element of the page; empty if there is none."""
        found = self.page.locator(place)
        return found.first.inner_text().strip() if found.count() else ""

    def until(self, place: str, words: str, timeout_s: float = 20.0) -> None:
        """Wait until an element of the page shows some text."""
        self.until_true(
            lambda: words in self.text(place), f"{place} never said {words!r}", timeout_s
        )

    def until_true(self, there: Callable[[], bool], words: str, timeout_s: float = 20.0) -> None:
        """Wait until a condition is true."""
        deadline = monotonic() + timeout_s
        while not there():
            if monotonic() > deadline:
                raise TimeoutError(
                    f"{words} within {timeout_s:g} s; it logged {self.errors}; "
                    f"{self.page.inner_text('body')}"
                )
            self.page.wait_for_timeout(50)

    def foreign(self) -> list[str]:
        """Return the requested addresses that are not the server's."""
        return [address for address in self.addresses if not address.startswith(self.origin)]


def origin_of(rig: RigFile) -> str:
    """Return the origin of the page of a rig."""
    return f"http://{rig.supervisor.host}:{rig.supervisor.port}"


def find_browser() -> str:
    """Return the path of a browser; skips the test if there is none."""
    path = next((path for name in NAMES if (path := shutil.which(name))), None)
    if path is None:
        pytest.skip(f"no browser on this machine ({', '.join(NAMES)})")
    return path


@contextmanager
def open_browser() -> Generator[Browser]:
    """Start a headless browser with a separate profile."""
    path = find_browser()
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=path, headless=True, args=list(FLAGS))
        try:
            yield browser
        finally:
            browser.close()


def visit(context: BrowserContext, origin: str, query: str = "") -> Visit:
    """Open the page of a rig and wait until it shows the rig."""
    page = context.new_page()
    seen = Visit(page, origin)
    page.on("console", lambda message: _note(seen, message.type, message.text))
    page.on("pageerror", lambda error: seen.errors.append(str(error)))
    page.on("request", lambda request: seen.addresses.append(request.url))
    page.goto(f"{origin}/{query}")
    seen.until("#connection", "connected")
    page.wait_for_selector("#fact-start")
    return seen


@contextmanager
def looked_at(browser: Browser, rig: RigFile, query: str = "") -> Generator[Visit]:
    """Open the page of a rig in one process; afterwards check that nothing was loaded from
    elsewhere or failed."""
    context = browser.new_context(viewport=ViewportSize(**DESK), color_scheme="light")
    try:
        seen = visit(context, origin_of(rig), query)
        yield seen
        assert seen.addresses
        assert seen.foreign() == []
        assert [error for error in seen.errors if "409" not in error] == []
    finally:
        context.close()


def _note(seen: Visit, kind: str, text: str) -> None:
    if kind in ("error", "warning"):
        seen.errors.append(f"{kind}: {text}")


def keep_picture(seen: Visit, folder: Path, name: str) -> Path:
    """Save a screenshot of the page."""
    folder.mkdir(parents=True, exist_ok=True)
    sleep(0.3)
    path = folder / f"page-{name}.png"
    seen.page.screenshot(path=path, animations="disabled")
    return path


def luminance(colour: str) -> float:
    """Return the relative luminance of ``rgb(r, g, b)``, as defined by WCAG 2."""
    channels = [float(part) / 255.0 for part in colour.split("(")[1].rstrip(")").split(",")[:3]]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    """Return the contrast of two colours, 1 to 21."""
    high, low = sorted((luminance(one), luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)
