import tomllib
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from pincette.config import RigFile, parse_rig
from pincette_supervisor.access.access import Access
from pincette_supervisor.access.authentication import Authenticator
from pincette_supervisor.config import STORE
from pincette_supervisor.journal.store import Store
from pincette_supervisor.plugin.drawing import Picture
from pincette_supervisor.results import archive
from tests.support.apps import create_app
from tests.support.keys import ScopeKeys, key_of_each_scope
from tests.support.stores import open_store

from .harness import Harness

DEMO = Path(__file__).parents[3] / "deploy" / "rigs" / "demo.toml"


BLANK = Picture(b"\x89PNG", {".svg": b'<svg xmlns="http://www.w3.org/2000/svg"/>', ".pdf": b"%PDF"})


def blank(*_of: object) -> Picture:
    """Empty content of pictures that are not drawn."""
    return BLANK


@pytest.fixture
def drawn() -> None:
    """Enable drawing, which takes most of a test's time; otherwise pictures are blank."""


@pytest.fixture(autouse=True)
def pictures(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep pictures blank except in the tests of drawing."""
    if "drawn" not in request.fixturenames:
        monkeypatch.setattr(archive, "picture", blank)


@pytest.fixture(scope="session")
def rig_file() -> RigFile:
    """Return the demo rig in lockstep, so that no sample has an age."""
    tables: dict[str, Any] = tomllib.loads(DEMO.read_text(encoding="utf-8"))
    tables["rig"]["time"] = "lockstep"
    return parse_rig(tables)


@pytest.fixture(scope="session")
def real_time() -> RigFile:
    return parse_rig(tomllib.loads(DEMO.read_text(encoding="utf-8")))


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    """An empty journal."""
    with closing(open_store(tmp_path / STORE)) as opened:
        yield opened


@pytest.fixture
def open_harness(tmp_path: Path) -> Iterator[Callable[..., Harness]]:
    harnesses: list[Harness] = []

    def open_one(rig: RigFile, **settings: Any) -> Harness:
        harnesses.append(Harness(rig, tmp_path, **settings))
        return harnesses[-1]

    yield open_one
    for harness in harnesses:
        harness.close()


@pytest.fixture
def harness(rig_file: RigFile, open_harness: Callable[..., Harness]) -> Harness:
    return open_harness(rig_file)


@pytest.fixture
def real(real_time: RigFile, open_harness: Callable[..., Harness]) -> Harness:
    """Return a supervisor of an idle rig in real time, whose clock does not advance."""
    harness = open_harness(real_time)
    harness.observer.clock = lambda: 100.0
    harness.bus.idle()
    return harness


@pytest.fixture
def ring(harness: Harness) -> ScopeKeys:
    """Make valid keys, one of each scope; they stay confirmed however long a test takes."""
    access = Access(Authenticator(clock=lambda: 0.0))
    harness.app = create_app(harness.rigs, access)
    return key_of_each_scope(harness.store, access.authenticator)
