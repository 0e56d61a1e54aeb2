import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from pincette.config import RigFile, parse_rig

from .harness import Harness

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
