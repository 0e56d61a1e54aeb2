"""The page's stop in browsers that lack functions, below a prefix, and against accidental keys."""

from collections.abc import Generator
from time import monotonic

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, Route, ViewportSize
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from tests.support.browser import DESK
from tests.support.served import served
from tests.unit.supervisor.harness import Harness

NO_STORAGE = """for (const name of ['sessionStorage', 'localStorage'])
  Object.defineProperty(window, name, { get() { throw new Error('denied'); } });"""
WORKS_WITHOUT = [
    "delete AbortSignal.timeout",
    "delete window.AbortController",
    "delete window.EventSource",
    "delete window.structuredClone",
    "delete Promise.allSettled",
    "delete Navigator.prototype.locks",
    "delete window.XMLHttpRequest",
    "delete window.PointerEvent",
    NO_STORAGE,
]
"""Functions without which the whole page works."""
STOPS_WITHOUT = [
    "delete window.fetch",
    "delete Crypto.prototype.getRandomValues",
    "delete Array.prototype.at",
    "delete String.prototype.replaceAll",
    "delete Element.prototype.replaceChildren",
    "delete window.ResizeObserver",
    "delete window.URLSearchParams",
    "delete window.performance",
]
"""Functions without which the page reports in red that it does not work."""
BLIND = "delete window.XMLHttpRequest; delete window.fetch;"
KEYS = """(presses) => {
  for (const press of presses) document.body.dispatchEvent(new KeyboardEvent('keydown',
    { key: 'Escape', bubbles: true, cancelable: true, ...press }));
}"""


@pytest.fixture
def address(desk: Harness) -> Generator[str]:
    with served(desk.app) as address:
        yield address


def text(page: Page, place: str) -> str:
    return page.locator(place).inner_text()


def until(page: Page, place: str, words: str, timeout_s: float = 20.0) -> None:
    deadline_s = monotonic() + timeout_s
    while words not in text(page, place):
        assert monotonic() < deadline_s, page.inner_text("header, #broken") + text(page, "#broken")
        page.wait_for_timeout(20)


def stop(desk: Harness, page: Page) -> None:
    """Press, and wait for the confirmation; afterwards the rig is reset."""
    before = len(desk.bus.trips)
    page.hover("#estop")
    page.mouse.down()
    page.mouse.up()
    until(page, "#estop-words", "confirmed by the actuator")
    assert len(desk.bus.trips) > before
    desk.manager.latch.reset("test")


def opened(browser: Browser, address: str, script: str) -> Page:
    page = browser.new_context(viewport=ViewportSize(**DESK)).new_page()
    page.add_init_script(script)
    page.goto(address)
    return page


@pytest.mark.parametrize(("scripts", "works"), [(WORKS_WITHOUT, True), (STOPS_WITHOUT, False)])
def test_the_stop_needs_no_optional_browser_function(
    browser: Browser, desk: Harness, address: str, scripts: list[str], works: bool
) -> None:
    for script in scripts:
        page = opened(browser, address, script)
        stop(desk, page)
        until(page, "#connection", "connected" if works else "page does not work")
        assert page.locator("#broken").is_visible() is not works, script
        page.context.close()


def test_the_stop_works_if_other_scripts_are_missing_or_damaged(
    context: BrowserContext, desk: Harness, address: str
) -> None:
    def blocked(route: Route) -> None:
        route.abort()

    def damaged(route: Route) -> None:
        route.fulfill(content_type="text/javascript", body="export const = ;")

    page = context.new_page()
    for place, act in (("**/page/**", blocked), ("**/page/js/words.js", damaged)):
        page.route(place, act)
        page.goto(address)
        until(page, "#broken", "E-STOP works")
        stop(desk, page)
        page.unroute_all(behavior="ignoreErrors")


def test_a_page_without_its_scripts_does_not_show_connecting_for_ever(
    context: BrowserContext, desk: Harness, address: str
) -> None:
    page = context.new_page()
    page.route("**/page/js/main.js", lambda _route: None)
    page.goto(address, wait_until="commit")
    stop(desk, page)
    until(page, "#broken", "it has not started")
    assert text(page, "#connection") == "page does not work"


@pytest.mark.parametrize("script", [BLIND, f"{BLIND} navigator.sendBeacon = undefined;"])
def test_a_browser_that_cannot_read_responses_sends_the_stop_as_a_form(
    context: BrowserContext, desk: Harness, address: str, script: str
) -> None:
    page = context.new_page()
    page.add_init_script(script)
    page.goto(address)
    page.click("#estop")
    page.wait_for_url("**/estop")
    assert '"acknowledged":true' in page.content()
    assert desk.bus.trips


@pytest.mark.parametrize(
    "answer",
    [
        "<html>Welcome</html>",
        '{"rig": "other", "acknowledged": true}',
        '{"rig": "demo", "acknowledged": "true"}',
        "null",
    ],
)
def test_only_a_response_of_the_rig_itself_confirms_a_stop(
    context: BrowserContext, desk: Harness, address: str, answer: str
) -> None:
    page = context.new_page()
    page.route("**/estop", lambda route: route.fulfill(body=answer))
    page.goto(address)
    page.click("#estop")
    until(page, "#estop-words", "NOT CONFIRMED")
    page.wait_for_timeout(300)
    assert "confirmed by" not in text(page, "#estop-words")
    assert desk.bus.trips == []


ACCIDENTS = [
    [{"isComposing": True}, {"isComposing": True}],
    [{"keyCode": 229}, {"keyCode": 229}],
    [{"isComposing": True}, {}],
    *[[{name: True}, {name: True}] for name in ("ctrlKey", "altKey", "metaKey", "shiftKey")],
    *[[{}, {name: True}] for name in ("ctrlKey", "altKey", "metaKey", "shiftKey")],
    [{}, {"repeat": True}, {"repeat": True}],
    [{}, {"key": "a"}, {}],
    [{}, {"isComposing": True}, {}],
]


def test_only_two_plain_presses_of_escape_stop_the_rig(
    context: BrowserContext, desk: Harness, address: str
) -> None:
    page = context.new_page()
    page.goto(address)
    until(page, "#connection", "connected")
    for presses in ACCIDENTS:
        page.evaluate(KEYS, presses)
        page.wait_for_timeout(820)
        assert page.locator("#estop-said").is_hidden(), presses
    assert desk.bus.trips == []
    for field in ("#job-text", "#field-sample", "body"):
        page.click("#tab-jobs" if field == "#job-text" else "#tab-start")
        page.locator(field).focus()
        page.keyboard.press("Escape")
        page.keyboard.press("Escape")
        until(page, "#estop-words", "confirmed by the actuator")
        desk.manager.latch.reset("test")
    assert len(desk.bus.trips) >= 3
    stops = len(desk.bus.trips)
    page.evaluate(KEYS, [{}, {}])  # assistive software sends keys that are not trusted
    page.wait_for_timeout(500)
    assert len(desk.bus.trips) > stops


REPLACED = (b"host", b"sec-fetch-site")
"""Replaced headers; browsers send the second only to secure addresses and loopback."""


def proxy(app: ASGIApp, *, prefix: str = "", host: str = "") -> ASGIApp:
    """A reverse proxy that removes a prefix and may replace ``Host``."""

    async def call(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await app(scope, receive, send)
            return
        path = str(scope["path"])
        if path != prefix and not path.startswith(f"{prefix}/"):
            await PlainTextResponse("another program")(scope, receive, send)
            return
        headers = [(k, v) for k, v in scope["headers"] if not host or k not in REPLACED]
        if host:
            headers.append((b"host", host.encode()))
        path = path.removeprefix(prefix) or "/"
        changed = {"path": path, "raw_path": path.encode(), "headers": headers}
        await app({**scope, **changed}, receive, send)

    return call


@pytest.mark.parametrize("place", ["/gripper", "/gripper?rig=demo"])
def test_the_page_works_under_a_path_prefix(
    context: BrowserContext, desk: Harness, place: str
) -> None:
    with served(proxy(desk.app, prefix="/gripper")) as address:
        page = context.new_page()
        page.goto(address + place)
        until(page, "#connection", "connected")
        page.wait_for_selector("#fact-start")
        assert page.locator("#stop-check").is_hidden()
        stop(desk, page)
        page.goto("about:blank")


def test_a_proxy_that_drops_host_is_named_with_its_remedy_when_the_page_loads(
    context: BrowserContext, desk: Harness
) -> None:
    with served(proxy(desk.app, host="127.0.0.1:9")) as address:
        page = context.new_page()
        page.goto(address)
        until(page, "#stop-check", "proxy_set_header Host")
        assert "WOULD NOT REACH demo" in text(page, "#stop-check")
        page.goto("about:blank")


@pytest.mark.parametrize(
    "answer", ["another program", '{"rig": "other", "supervisor": "", "stop": {"accepted": true}}']
)
def test_an_answer_of_another_program_is_named_when_the_page_loads(
    context: BrowserContext, address: str, answer: str
) -> None:
    page = context.new_page()
    page.route("**/page-check", lambda route: route.fulfill(body=answer))
    page.goto(address)
    until(page, "#stop-check", "WOULD NOT REACH demo")
    page.unroute_all()
    page.locator("#stop-check").wait_for(state="hidden", timeout=15_000)
