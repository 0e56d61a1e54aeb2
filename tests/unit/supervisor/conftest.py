import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from pincette.config import RigFile, parse_rig

from .rig import Desk

DEMO = Path(__file__).parents[3] / "deploy" / "rigs" / "demo.toml"


@pytest.fixture
def rig_file() -> RigFile:
    """The demo rig in lockstep, so that no sample has an age."""
    tables: dict[str, Any] = tomllib.loads(DEMO.read_text(encoding="utf-8"))
    tables["rig"]["time"] = "lockstep"
    return parse_rig(tables)


@pytest.fixture
def real_time() -> RigFile:
    return parse_rig(tomllib.loads(DEMO.read_text(encoding="utf-8")))


@pytest.fixture
def open_desk(tmp_path: Path) -> Iterator[Callable[..., Desk]]:
    desks: list[Desk] = []

    def open_one(rig: RigFile, **settings: Any) -> Desk:
        desks.append(Desk(rig, tmp_path, **settings))
        return desks[-1]

    yield open_one
    for desk in desks:
        desk.close()


@pytest.fixture
def desk(rig_file: RigFile, open_desk: Callable[..., Desk]) -> Desk:
    return open_desk(rig_file)
