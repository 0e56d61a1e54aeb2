"""Forces that are requested one after another, and stops in each phase, with a SiLA client."""

from collections.abc import Generator
from pathlib import Path

import pytest
from sila2.framework import DefinedExecutionError

from contrib.support.reaching import SLOW, STOPS, NotReachedError, climb, stop_and_ask_again
from contrib.support.sila import responses, stock_client
from pincette.config.reading import laid_over
from tests.support.adapters import adapter_rig, ports_of_adapters
from tests.support.grips import make_ready
from tests.support.running import RunningRig


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    changes = laid_over(ports_of_adapters(), SLOW)
    with adapter_rig(tmp_path_factory.mktemp("sila"), changes, ["sila"]) as found:
        yield found


class Commands:
    """``Grip`` and ``Release``, each awaited until it returns its responses."""

    def __init__(self, rig: RunningRig) -> None:
        self.rig = rig

    def reach(self, force_mN: float) -> float:
        with stock_client(self.rig) as client:
            try:
                held = responses(client.Microgripper.Grip(force_mN, 0.0, ""))
            except DefinedExecutionError as error:
                raise NotReachedError(error.message) from error
        assert held.Outcome == "held"
        return held.HeldForce

    def release(self) -> None:
        with stock_client(self.rig) as client:
            try:
                assert responses(client.Microgripper.Release()).Outcome == "released"
            except DefinedExecutionError as error:
                raise NotReachedError(error.message) from error


@pytest.fixture
def ready(running: RunningRig) -> RunningRig:
    make_ready(running)
    return running


def test_forces_are_reached_one_after_another_without_a_release(
    ready: RunningRig, tmp_path: Path
) -> None:
    climb(ready, Commands(ready), tmp_path)


@pytest.mark.parametrize("phase", STOPS)
def test_a_force_is_reached_after_a_stop_in_each_phase(ready: RunningRig, phase: str) -> None:
    stop_and_ask_again(ready, Commands(ready), phase)
