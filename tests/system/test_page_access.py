"""The page if the supervisor requires a key: sign-in, scopes, and the emergency stop."""

from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from time import monotonic

import httpx
import pytest
from playwright.sync_api import Browser, BrowserContext
from starlette.types import Receive, Scope, Send

from pincette.api import access as access_models
from pincette_supervisor.access.access import Access
from pincette_supervisor.access.authentication import digest_of, new_key
from pincette_supervisor.access.key_store import KeyStore
from pincette_supervisor.journal.access import AuditRepository, KeyFile
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rest.api import create_app
from tests.support.browser import Visit, visit
from tests.support.rigs import demo_rig
from tests.support.served import served
from tests.unit.supervisor.harness import Harness

LONG_S = 60.0
EXPECTED = ("401", "403", "409")
"""Refusals that a browser logs as errors."""


@dataclass
class Bench:
    """A simulated rig behind a real server, whose page a real browser opens."""

    desk: Harness
    access: Access
    address: str

    def key(self, name: str, scope: access_models.Scope) -> str:
        """Make a key that is valid immediately."""
        key = new_key()
        KeyFile(self.desk.store.folder).add(name, digest_of(key), scope)
        self.access.authenticator.refresh(self.desk.store)
        return key


@pytest.fixture
def bench(browser: Browser, tmp_path: Path) -> Generator[Bench]:
    assert browser.is_connected()
    desk, access = Harness(demo_rig(time="lockstep"), tmp_path), Access()
    desk.app = create_app(desk.rigs, access)
    try:
        with served(desk.app) as address:
            yield Bench(desk, access, address)
    finally:
        desk.close()


@pytest.fixture
def foreign() -> Generator[str]:
    with served(elsewhere) as address:
        yield address


def sign_in(seen: Visit, key: str) -> None:
    seen.page.fill("#sign-in-key", key)
    seen.page.press("#sign-in-key", "Enter")


def barred(seen: Visit, place: str) -> str:
    """Return why a control is disabled; empty if it is enabled."""
    control = seen.page.locator(place)
    return str(control.get_attribute("title") or "") if control.is_disabled() else ""


def test_the_banner_of_a_stop_states_who_pressed_and_when(
    bench: Bench, context: BrowserContext
) -> None:
    seen = visit(context, bench.address)
    address = f"{bench.address}/api/v1/rigs/demo/estop"
    assert httpx.post(address, headers={"X-Operator": "Ada"}).status_code == 200
    seen.until("#latch-cause", "Cause: emergency stop, by Ada, at ", LONG_S)
    seen.page.reload()
    seen.until("#latch-cause", "Cause: emergency stop, by Ada, at ", LONG_S)


def test_a_signed_in_page_permits_what_its_key_permits(
    bench: Bench, context: BrowserContext
) -> None:
    seen = visit(context, bench.address)
    assert seen.page.locator("#sign-in").is_hidden()
    assert seen.page.locator("#who").is_hidden()
    assert barred(seen, "#start") == ""

    seer, operator = bench.key("seer", "observe"), bench.key("cell-7", "operate")
    seen.until("#sign-in", "This supervisor requires a key")
    seen.page.click("#estop")
    seen.until("#estop-said", "confirmed by the actuator")
    bench.desk.manager.latch.reset("test")
    sign_in(seen, "pincette_wrong")
    seen.until("#sign-in-said", "is not accepted")

    sign_in(seen, seer)
    seen.until("#who", "seer · observe")
    seen.until("#may", "see everything")
    seen.until("#connection", "connected")
    assert seen.page.locator("#sign-in").is_hidden()
    assert barred(seen, "#start") == "needs scope operate; seer has observe"
    assert barred(seen, "#dry-run") != ""
    seen.page.click("#estop")
    seen.until("#estop-said", "confirmed by the actuator")
    seen.until("#latch-cause", "emergency stop")
    assert "needs scope operate" in barred(seen, "#reset-open")

    seen.page.reload()
    seen.until("#who", "seer · observe")
    seen.until("#facts", "latched")
    seen.until_true(lambda: "needs scope operate" in barred(seen, "#start"), "start is not barred")
    stored = seen.page.evaluate("document.cookie + JSON.stringify({...localStorage})")
    assert seer not in stored
    assert "pincette_session" not in stored

    seen.page.click("#sign-out")
    seen.until("#sign-in", "This supervisor requires a key")
    sign_in(seen, operator)
    seen.until("#who", "cell-7 · operate")
    seen.page.click("#reset-open")
    seen.page.check("#reset-seen")
    seen.page.click("#reset button[type=submit]")
    seen.until("#fact-start", "can start")
    assert barred(seen, "#start") == ""
    seen.until_true(lambda: seen.page.input_value("#field-force_mN") != "", "no defaults came")
    seen.page.click("#start")
    seen.until("#current-state", "succeeded", 60.0)
    seen.page.click("#current-open")
    seen.until("#job-detail", "Requested by cell-7")
    seen.page.click("#tab-rig")
    seen.until("#rig-model", "in use")

    assert seen.foreign() == []
    assert [one for one in seen.errors if not any(code in one for code in EXPECTED)] == []


async def elsewhere(_scope: Scope, _receive: Receive, send: Send) -> None:
    """Serve a page of another server on this machine."""
    headers = [(b"content-type", b"text/html")]
    await send({"type": "http.response.start", "status": 200, "headers": headers})
    await send({"type": "http.response.body", "body": b"<p>elsewhere</p>"})


def test_a_page_of_another_origin_can_neither_act_nor_read_nor_frame(
    bench: Bench, foreign: str, context: BrowserContext
) -> None:
    """For a browser that page belongs to the same site, so cookies would be sent."""
    origin = bench.address
    name = bench.desk.manager.name
    page = context.new_page()
    received: list[str] = []
    page.on("console", lambda message: received.append(message.text))
    page.goto(foreign)
    read = page.evaluate(
        """async ([origin, rig]) => {
          const place = `${origin}/api/v1/rigs/${rig}/estop`;
          await fetch(place, { method: "POST", mode: "no-cors" }).catch(() => {});
          const read = await fetch(`${origin}/livez`).then(() => true, () => false);
          const frame = document.createElement("iframe");
          frame.src = origin;
          const loaded = new Promise((go) => { frame.onload = go; setTimeout(go, 2000); });
          document.body.append(frame);
          await loaded;
          return read;
        }""",
        [origin, name],
    )
    assert read is False
    begun_s = monotonic()
    while not [text for text in received if "frame-ancestors" in text]:
        assert monotonic() - begun_s < LONG_S, received
        page.wait_for_timeout(50)
    book = AuditRepository(bench.desk.store)
    bench.access.audit_buffer.flush(book, everything=True)
    refused = [(row.action, row.status) for row in book.newest(10)]
    assert refused == [(f"POST /api/v1/rigs/{name}/estop", 403)]
    assert bench.desk.told("alarm") == []


def test_a_person_signs_in_by_password_and_claims_the_rig(
    bench: Bench, context: BrowserContext
) -> None:
    seen = visit(context, bench.address)
    store = bench.desk.store
    KeyStore(KeyFile(store.folder), store).add_user("ann", "operate", "of ten and more")
    bench.access.authenticator.refresh(store)
    seen.until("#sign-in", "This supervisor requires a key")
    seen.page.fill("#sign-in-user", "ann")
    sign_in(seen, "of ten and less")
    seen.until("#sign-in-said", "is not accepted")
    sign_in(seen, "of ten and more")
    seen.until("#who", "ann · operate")
    seen.page.click("#tab-rig")
    seen.page.click("#claim-take")
    seen.until("#claim", "Claimed by this page")
    claim = bench.desk.manager.claims.current()
    assert claim is not None
    assert claim.by == "ann"
    with pytest.raises(ProblemError, match="claimed by ann"):
        bench.desk.manager.claims.require("the secret of another")
    seen.page.click("#tab-start")
    seen.until("#fact-start", "can start")
    seen.until_true(lambda: seen.page.input_value("#field-force_mN") != "", "no defaults came")
    seen.page.click("#start")
    seen.until("#current-state", "succeeded", LONG_S)
    seen.page.click("#tab-rig")
    seen.page.click("#claim-return")
    seen.until("#claim", "The rig is not claimed")
    assert bench.desk.manager.claims.current() is None
