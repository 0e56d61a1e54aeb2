"""The page if a supervisor serves two rigs: all its content belongs to the rig in the address."""

from collections.abc import Generator
from contextlib import contextmanager

import pytest
from playwright.sync_api import Browser

from pincette.config.reading import laid_over
from pincette.engine.fleet import Fleet
from tests.support.browser import Visit, looked_at
from tests.support.grips import SHORT
from tests.support.rigs import demo_rig, rig_toml
from tests.support.running import Json, RunningRig, running_rig

LONG_S = 90.0
"""Rigs in lockstep are as slow as the machine is loaded."""


@pytest.fixture(scope="module")
def left(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    """The rig with router and supervisor; the other, ``right``, has joined it."""
    assert browser.is_connected()
    folder = tmp_path_factory.mktemp("rigs")
    own = demo_rig(laid_over(SHORT, {"rig": {"name": "left"}}), time="lockstep")
    with running_rig(own, folder) as running, joined(running):
        yield running


@contextmanager
def joined(left: RunningRig) -> Generator[None]:
    joins = {
        "rig": {"name": "right"},
        "bus": {"router": f"127.0.0.1:{left.rig.bus.port}"},
        "supervisor": {"port": left.rig.supervisor.port},
    }
    right = demo_rig(laid_over(SHORT, joins), time="lockstep")
    path = left.path.with_name("right.toml")
    path.write_text(rig_toml(right), encoding="utf-8")
    fleet = Fleet(right, path, left.data, lambda _name, _line: None)
    try:
        fleet.up()
        yield
    finally:
        fleet.down()


@pytest.fixture
def seen(left: RunningRig, browser: Browser) -> Generator[Visit]:
    with looked_at(browser, left.rig) as visited:
        visited.until("#rigs", "right", LONG_S)
        visited.until("#rig-right", "can start", LONG_S)
        yield visited


def rig(left: RunningRig, name: str) -> Json:
    return left.get(f"/rigs/{name}")


def test_a_rig_is_chosen_and_the_page_follows_it(left: RunningRig, seen: Visit) -> None:
    assert seen.text("#rig-name") == "left"
    seen.page.click("#rig-right")
    seen.until("#rig-name", "right")
    assert seen.page.url.endswith("?rig=right")
    seen.until("#fact-start", "can start", LONG_S)
    seen.until_true(lambda: seen.page.input_value("#field-force_mN") == "8", "no defaults came")
    seen.page.click("#start")
    seen.until("#current-state", "succeeded", LONG_S)
    job = left.job(seen.text("#current-open"))
    assert (job["rig"], job["state"]) == ("right", "succeeded")
    assert seen.page.locator("#job-list tbody tr").count() == 1
    seen.page.goto(f"{seen.origin}/?rig=left")
    seen.until("#current", "No job yet")


def test_estop_names_its_rig_and_stops_no_other(left: RunningRig, seen: Visit) -> None:
    seen.page.goto(f"{seen.origin}/?rig=right")
    assert seen.text("#estop").split() == ["E-STOP", "right"]
    seen.until("#fact-start", "can start", LONG_S)
    seen.page.click("#estop")
    seen.until("#estop-said", "E-STOP of right confirmed by the actuator", LONG_S)
    seen.until_true(lambda: rig(left, "right")["latch"]["cause"] == "estop", "it never tripped")
    assert rig(left, "left")["latch"]["cause"] != "estop"
    seen.until("#rig-right", "cannot start", LONG_S)
    assert "can start" in seen.text("#rig-left")
