"""Type the blocks of a page as a reader would, in a checkout and with a separate rig."""

import os
import re
import shlex
import sys
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from tests.support.checkout import ROOT, await_text, demo_ports, run, until_interrupted
from tests.support.checkout import workspace as shown
from tests.support.documents import Block, Sitting, Typed, named

UP_S = 90.0


def cases(sittings: dict[str, Sitting]) -> list[object]:
    """Return a case for each page of a register; pages that take minutes are marked slow."""
    return [
        pytest.param(page, sitting, id=page, marks=[pytest.mark.slow] if sitting.slow else [])
        for page, sitting in sittings.items()
    ]


@contextmanager
def reader_checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Generator[Path]:
    """Show the checkout in a folder whose .venv is this environment; installs go elsewhere."""
    tools = Path(sys.executable).parent
    monkeypatch.setenv("PATH", f"{tools}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PIP_NO_DEPS", "1")
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    monkeypatch.delenv("PINCETTE_RIG", raising=False)

    for name in ("PIP_TARGET", "PYTHONPATH"):
        monkeypatch.setenv(name, str(tmp_path / "packages"))
    place = shown(tmp_path / "pincette")
    (place / "data").mkdir()
    (place / ".venv").unlink(missing_ok=True)
    (place / ".venv").symlink_to(sys.prefix)
    with demo_ports():
        yield place


def script(block: Block, folder: Path) -> str:
    """Return a block preceded by earlier exports, which a reader's shell would keep."""
    state = folder / "shell-state"
    state.touch()
    body = block.text
    if block.language == "python":
        program = folder / "typed.py"
        program.write_text(block.text, encoding="utf-8")
        body = f"python {shlex.quote(str(program))}\n"
    return f"set -eua\n. {state}\n{body}\nexport -p | grep -v ' PATH=' > {state}\n"


class Reader:
    """Types the blocks of a page, one after the other."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self._folder, self._stack, self._logs = folder, stack, 0

    def stay(self, words: list[str], says: str) -> None:
        """Start a command that runs until the end of the page."""
        self._await(self._stack, words, says)

    def watch(self, words: list[str], says: str) -> None:
        """Start a command that is ended with Ctrl-C once it has printed something."""
        with ExitStack() as stack:
            self._await(stack, words, says)

    def _await(self, stack: ExitStack, words: list[str], says: str) -> None:
        self._logs += 1
        log = self._folder / f"typed-{self._logs}.log"
        process = stack.enter_context(until_interrupted(words, self._folder, log))
        await_text(log, says, process, UP_S)

    def type(self, block: Block, typed: Typed) -> None:
        """Type a block, and check its exit status and its output."""
        text = script(block, self._folder)
        if typed.stays or typed.until:
            begin = self.stay if typed.stays else self.watch
            begin(["bash", "-c", text.replace(block.text, f"exec {block.text}")], typed.says)
            return
        done = run(["bash", "-c", text], self._folder, typed.seconds)
        assert done.returncode == typed.status, f"{block.text}\n{done.stdout}"
        assert re.search(typed.says, done.stdout), f"{block.text}\n{done.stdout}"


def joined(page: str, sitting: Sitting) -> list[tuple[Block, Typed]]:
    """Join typed blocks of Python that follow each other: they are one program."""
    found: list[tuple[Block, Typed]] = []
    for block, typed in named(page, sitting):
        if block.language == "python" and found and found[-1][0].language == "python":
            before, first = found.pop()
            text = f"{before.text}\n{block.text}"
            both = rf"(?s){first.says}.*{typed.says}"
            found.append((Block(page, "python", text), Typed(typed.first, both, seconds=120.0)))
        else:
            found.append((block, typed))
    return found


def type_page(page: str, sitting: Sitting, checkout: Path) -> None:
    """Type the registered blocks of a page; fail if a block's status or output differs."""
    with ExitStack() as stack:
        reader = Reader(checkout, stack)
        if sitting.up:
            reader.stay(["pincette", "up", "--rig", sitting.up], "is up at http://127.0.0.1:8000")
        for block, typed in joined(page, sitting):
            reader.type(block, typed)
    left = [path for path in (ROOT / "docs/examples/driver").iterdir() if path.is_dir()]
    assert [path.name for path in left if path.name != "__pycache__"] == []
