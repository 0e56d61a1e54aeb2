"""The page in Firefox: stops, typed numbers, keys, the wheel, and eight windows."""

from collections.abc import Generator
from pathlib import Path
from time import monotonic

import pytest

from tests.support.firefox import Firefox, open_firefox
from tests.support.rigs import demo_rig
from tests.support.served import served
from tests.unit.supervisor.harness import Harness

CONNECTED = "return document.querySelector('#connection').textContent === 'connected'"
CONFIRMED = "return document.querySelector('#estop-said').dataset.tone === 'good'"
VALUE = "return document.querySelector('#field-force_mN').value"
COMPOSED = """
for (const press of arguments[0]) document.body.dispatchEvent(new KeyboardEvent('keydown',
  { key: 'Escape', bubbles: true, cancelable: true, ...press }));
"""
ESCAPE, UP, DOWN = "\ue00c", "\ue013", "\ue015"


@pytest.fixture(scope="module")
def firefox(tmp_path_factory: pytest.TempPathFactory) -> Generator[Firefox]:
    with open_firefox(tmp_path_factory.mktemp("firefox")) as opened:
        yield opened


@pytest.fixture
def desk(tmp_path: Path) -> Generator[Harness]:
    made = Harness(demo_rig(time="lockstep"), tmp_path)
    yield made
    made.close()


@pytest.fixture
def page(firefox: Firefox, desk: Harness) -> Generator[Firefox]:
    """Open the page of a simulated rig, and wait until it is connected and its form has the
    planned values."""
    with served(desk.app) as address:
        firefox.command("Navigate", url=address)
        firefox.until(CONNECTED)
        firefox.until(VALUE)
        yield firefox
        firefox.command("Navigate", url="about:blank")


def stop(desk: Harness, page: Firefox) -> float:
    """Press E-STOP, wait for the confirmation, and return the time that took, in s."""
    before, begun_s = len(desk.bus.trips), monotonic()
    page.click("#estop")
    page.until(CONFIRMED)
    taken_s = monotonic() - begun_s
    assert len(desk.bus.trips) > before
    desk.manager.latch.reset("test")
    return taken_s


def test_a_press_of_the_stop_button_stops_the_rig(page: Firefox, desk: Harness) -> None:
    stop(desk, page)
    page.run("delete AbortSignal.timeout; delete window.AbortController")
    stop(desk, page)


def test_a_plan_uses_the_typed_number(page: Firefox) -> None:
    page.type_into("#field-force_mN", "2,5")
    assert page.text("#field-force_mN-read") == "= 2.5 mN"
    page.click("#dry-run")
    page.until("return document.querySelector('#plan-sent')?.textContent.includes('2.5 mN')")
    page.type_into("#field-force_mN", "5e")
    page.click("#dry-run")
    page.until("return document.querySelector('#field-force_mN-fault')?.textContent")
    assert page.run(VALUE) == "5e"


def test_only_plain_presses_of_escape_stop(page: Firefox, desk: Harness) -> None:
    for press in ({"isComposing": True}, {"ctrlKey": True}, {"repeat": True}, {"keyCode": 229}):
        page.run(COMPOSED, [press, press])
    assert desk.bus.trips == []
    page.press(ESCAPE, ESCAPE)
    page.until(CONFIRMED)
    assert len(desk.bus.trips) > 0
