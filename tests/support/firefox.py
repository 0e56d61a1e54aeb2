"""Headless Firefox, driven over Marionette, its built-in protocol."""

import json
import os
import shutil
import signal
import socket
import subprocess
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import pytest

from tests.support.rigs import free_ports

NAMES = ("firefox-esr", "firefox")
START_S, REPLY_S = 60.0, 60.0
PREFERENCES = """\
user_pref("marionette.port", {port});
user_pref("browser.shell.checkDefaultBrowser", false);
user_pref("browser.startup.page", 0);
user_pref("datareporting.policy.dataSubmissionEnabled", false);
user_pref("app.update.enabled", false);
user_pref("network.captive-portal-service.enabled", false);
user_pref("network.connectivity-service.enabled", false);
"""
ELEMENT = "element-6066-11e4-a52e-4f735466cecf"
"""Name of an element's reference, by the WebDriver standard."""


class MarionetteError(Exception):
    """The browser refused a command."""


@dataclass
class Firefox:
    """A running browser; each method is a command of WebDriver."""

    line: socket.socket
    number: int = 0

    def command(self, name: str, **parameters: Any) -> Any:
        """Send a command and return its result."""
        self.number += 1
        content = json.dumps([0, self.number, f"WebDriver:{name}", parameters]).encode()
        self.line.sendall(b"%d:%s" % (len(content), content))
        _, _, error, result = _read(self.line)
        if error:
            raise MarionetteError(f"{name}: {error['error']}: {error['message']}")
        found: dict[str, Any] = result or {}
        return found.get("value", found) if isinstance(result, dict) else result

    def run(self, script: str, *arguments: Any) -> Any:
        """Run the body of a function in the page and return what it returns."""
        return self.command("ExecuteScript", script=script, args=list(arguments), sandbox=None)

    def until(self, script: str, *arguments: Any, timeout_s: float = 60.0) -> None:
        """Wait until the body of a function returns something true."""
        until_s = monotonic() + timeout_s
        while not self.run(script, *arguments):
            if monotonic() > until_s:
                page = self.run("return document.body.innerText")
                raise TimeoutError(f"{script} within {timeout_s:g} s:\n{page}")
            sleep(0.05)

    def text(self, place: str) -> str:
        """Return the text of an element."""
        return str(self.run("return document.querySelector(arguments[0]).textContent", place))

    def element(self, place: str) -> dict[str, str]:
        """Return a reference to an element, scrolled into view."""
        found = self.command("FindElement", using="css selector", value=place)
        self.run("arguments[0].scrollIntoView({block: 'center'})", found)
        return found

    def click(self, place: str) -> None:
        """Press and release the primary button over an element."""
        self.command("ElementClick", id=self.element(place)[ELEMENT])

    def type_into(self, place: str, text: str) -> None:
        """Replace the text of a field by typing."""
        reference = self.element(place)[ELEMENT]
        self.command("ElementClear", id=reference)
        self.command("ElementSendKeys", id=reference, text=text)

    def press(self, *keys: str) -> None:
        """Press and release keys one after the other, wherever the focus is."""
        acts = [{"type": kind, "value": key} for key in keys for kind in ("keyDown", "keyUp")]
        self.command("PerformActions", actions=[{"type": "key", "id": "keys", "actions": acts}])
        self.command("ReleaseActions")

    def wheel(self, place: str, distance_px: int) -> None:
        """Turn the wheel over an element."""
        act = {
            "type": "scroll",
            "x": 0,
            "y": 0,
            "deltaX": 0,
            "deltaY": distance_px,
            "origin": self.element(place),
        }
        self.command("PerformActions", actions=[{"type": "wheel", "id": "w", "actions": [act]}])
        self.command("ReleaseActions")


def _read(line: socket.socket) -> Any:
    """Return the next message: its length, a colon, and JSON."""
    length = b""
    while not length.endswith(b":"):
        length += _received(line, 1)
    content = b""
    while len(content) < int(length[:-1]):
        content += _received(line, int(length[:-1]) - len(content))
    return json.loads(content)


def _received(line: socket.socket, count: int) -> bytes:
    part = line.recv(count)
    if not part:
        raise MarionetteError("the browser has ended")
    return part


@contextmanager
def open_firefox(folder: Path) -> Generator[Firefox]:
    """Start Firefox with a separate profile; skips the test if there is none."""
    path = next((path for name in NAMES if (path := shutil.which(name))), None)
    if path is None:
        pytest.skip(f"no Firefox on this machine ({', '.join(NAMES)})")
    port, profile = free_ports(1), folder / "profile"
    profile.mkdir()
    (profile / "user.js").write_text(PREFERENCES.format(port=port), encoding="utf-8")
    process = subprocess.Popen(
        [path, "--headless", "--marionette", "--no-remote", "--profile", str(profile)],
        env=os.environ | {"HOME": str(folder), "MOZ_CRASHREPORTER_DISABLE": "1"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        with _connected(port, process.poll) as line:
            _read(line)
            browser = Firefox(line)
            browser.command("NewSession", strictFileInteractability=True)
            yield browser
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGTERM)
        try:
            process.wait(20.0)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def _connected(port: int, ended: Callable[[], int | None]) -> socket.socket:
    until_s = monotonic() + START_S
    while True:
        try:
            line = socket.create_connection(("127.0.0.1", port), 1.0)
        except OSError:
            if ended() is not None or monotonic() > until_s:
                raise
            sleep(0.1)
        else:
            line.settimeout(REPLY_S)
            return line
