"""Many windows of one browser: each is live, and a stop from each one acts at once."""

from time import monotonic

import pytest
from playwright.sync_api import Browser, BrowserContext, Page

from tests.support.browser import origin_of
from tests.support.grips import make_ready
from tests.support.running import RunningRig

WINDOWS = 8
STOP_S, SLOWER = 1.0, 4.0
LIVE = """() => document.querySelector('#connection').textContent === 'connected'
  && !document.body.classList.contains('still') && !document.body.classList.contains('stale')"""
SAMPLED = "/[0-9]/.test(document.querySelector('#readouts .figure').textContent)"
PRESS = """async () => {
  const begun = performance.now();
  document.querySelector('#estop').click();
  while (document.querySelector('#estop-said').dataset.tone !== 'good') {
    if (performance.now() - begun > 20000) return NaN;
    await new Promise((go) => setTimeout(go, 5));
  }
  return (performance.now() - begun) / 1000;
}"""
SAMPLE_S = 5.0
"""Longest wait for a sample on a busy machine, in s."""


@pytest.fixture(scope="module")
def rig(browser: Browser, paced: RunningRig) -> RunningRig:
    assert browser.is_connected()
    make_ready(paced)
    return paced


def open_windows(context: BrowserContext, rig: RunningRig, count: int = WINDOWS) -> list[Page]:
    pages = [context.new_page() for _ in range(count)]
    for page in pages:
        page.goto(origin_of(rig.rig))
    return pages


def until_live(page: Page, condition: str = LIVE) -> None:
    deadline_s = monotonic() + 30.0
    while not page.evaluate(condition):
        assert monotonic() < deadline_s, page.inner_text("body")
        page.wait_for_timeout(50)


def stop_from(rig: RunningRig, page: Page) -> float:
    """Press in a window; returns the time until the window shows the confirmation."""
    taken_s = float(page.evaluate(PRESS))
    # The view of the rig follows the actuator's next sample.
    deadline_s = monotonic() + SAMPLE_S
    while rig.view()["latch"]["cause"] != "estop":
        assert monotonic() < deadline_s, rig.view()["latch"]
    make_ready(rig)
    return taken_s


def allowed_s(alone_s: float) -> float:
    """Return the longest time of a stop from one of many windows; a slow machine is slow with
    one, too."""
    return max(STOP_S, SLOWER * alone_s)


def test_eight_browser_windows_are_live_and_each_one_stops_the_rig(
    rig: RunningRig, context: BrowserContext, figures: list[str]
) -> None:
    pages = open_windows(context, rig, 1)
    until_live(pages[0])
    alone_s = min(stop_from(rig, pages[0]) for _ in range(3))
    pages += open_windows(context, rig, WINDOWS - 1)
    for page in pages:
        until_live(page)
    rig.post("/jobs", {"kind": "move", "to_um": 12.0, "autostart": True})
    for page in pages:
        until_live(page, SAMPLED)
    taken_s = [stop_from(rig, page) for page in pages]
    figures.append(f"e-stop from {WINDOWS} windows of one browser: {max(taken_s):.2f} s at most")
    assert max(taken_s) <= allowed_s(alone_s)
    assert all(page.evaluate(LIVE) for page in pages)


def test_a_browser_window_stops_the_rig_while_the_others_occupy_every_connection(
    rig: RunningRig, context: BrowserContext, figures: list[str]
) -> None:
    """Six streams of another window leave no connection for a request with credentials."""
    (page,) = open_windows(context, rig, 1)
    until_live(page)
    hog = context.new_page()
    hog.goto(origin_of(rig.rig))
    address = f"{origin_of(rig.rig)}/api/v1/rigs/{rig.rig.rig.name}/events"
    hog.evaluate("address => { for (let i = 12; i; i -= 1) new EventSource(address); }", address)
    page.wait_for_timeout(500)
    taken_s = stop_from(rig, page)
    figures.append(f"e-stop from a window without a connection: {taken_s:.2f} s")
    assert taken_s <= STOP_S


def test_the_other_windows_stay_live_if_the_window_with_the_stream_is_closed_or_hangs(
    rig: RunningRig, context: BrowserContext
) -> None:
    first, second, third = open_windows(context, rig, 3)
    for page in (first, second, third):
        until_live(page)
    first.close()
    second.wait_for_timeout(1000)
    for page in (second, third):
        until_live(page)
    begun_s = monotonic()
    second.evaluate("setTimeout(() => { const to = Date.now() + 4000; while (Date.now() < to); })")
    while monotonic() - begun_s < 3.5:
        third.wait_for_timeout(250)
        assert third.evaluate(LIVE)
    assert stop_from(rig, third) <= STOP_S
