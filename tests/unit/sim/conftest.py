from pathlib import Path

import pytest

from pincette.config import RigFile, Simulation, read_rig

DEMO = Path(__file__).parents[3] / "deploy" / "rigs" / "demo.toml"


@pytest.fixture
def demo() -> RigFile:
    return read_rig(DEMO)


@pytest.fixture
def simulation(demo: RigFile) -> Simulation:
    assert demo.simulation is not None
    return demo.simulation
