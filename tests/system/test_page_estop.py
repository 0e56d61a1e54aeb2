"""A press of the page's E-STOP is stored and sent again until the actuator confirms it."""

from contextlib import ExitStack

from playwright.sync_api import BrowserContext

from pincette_supervisor.rest.api import create_app
from tests.support.browser import Visit, visit
from tests.support.keys import key_of_each_scope
from tests.support.rigs import free_ports
from tests.support.served import served
from tests.unit.supervisor.harness import Harness

OTHERWISE = ("pincette estop on the rig's computer", "the button of the amplifier's supply")


def not_confirmed(seen: Visit, why: str) -> None:
    seen.until("#estop-words", "NOT CONFIRMED", 10.0)
    seen.until("#estop-words", why, 10.0)
    for way in OTHERWISE:
        assert way in seen.text("#estop-words")


def test_a_stop_press_survives_a_restart_of_the_supervisor(
    desk: Harness, context: BrowserContext
) -> None:
    port = free_ports(1)
    with ExitStack() as first:
        first.enter_context(served(desk.app, port))
        seen = visit(context, f"http://127.0.0.1:{port}")
    seen.page.click("#estop")
    not_confirmed(seen, "the supervisor does not answer")
    seen.until("#estop-tries", "Sent 3× since", 15.0)
    assert desk.bus.trips == []
    with served(create_app(desk.rigs), port):
        seen.until("#estop-words", "confirmed by the actuator", 15.0)
        seen.page.wait_for_timeout(500)
        stops = len(desk.bus.trips)
        seen.page.wait_for_timeout(1000)
    assert len(desk.bus.trips) == stops > 0


def test_a_stop_press_survives_a_page_reload_and_can_be_withdrawn(
    desk: Harness, context: BrowserContext
) -> None:
    with served(desk.app) as address:
        seen = visit(context, address)
        context.route("**/estop", lambda route: route.abort())
        seen.page.click("#estop")
        not_confirmed(seen, "the supervisor does not answer")
        seen.page.reload()
        not_confirmed(seen, "the supervisor does not answer")
        context.unroute("**/estop")
        seen.until("#estop-words", "confirmed by the actuator", 10.0)
        stops = len(desk.bus.trips)
        assert stops > 0
        desk.manager.latch.reset("test")
        context.route("**/estop", lambda route: route.abort())
        seen.page.click("#estop")
        not_confirmed(seen, "the supervisor does not answer")
        seen.page.click("#estop-withdraw")
        context.unroute("**/estop")
        seen.page.reload()
        seen.until("#connection", "connected")
        seen.page.wait_for_timeout(1500)
        assert seen.page.locator("#estop-said").is_hidden()
    assert len(desk.bus.trips) == stops


def test_an_actuator_that_does_not_confirm_is_reported(
    desk: Harness, context: BrowserContext
) -> None:
    desk.bus.silent.add("actuator")
    with served(desk.app) as address:
        seen = visit(context, address)
        seen.page.click("#estop")
        not_confirmed(seen, "actuator")
        desk.bus.silent.clear()
        seen.until("#estop-words", "confirmed by the actuator", 10.0)


def test_a_stop_button_needs_no_sign_in_and_reports_refusals(
    desk: Harness, context: BrowserContext
) -> None:
    key_of_each_scope(desk.store, desk.app.state.access.authenticator)
    with served(desk.app) as address:
        page = context.new_page()
        seen = Visit(page, address)
        page.goto(address)
        seen.until("#sign-in", "E-STOP needs no key")
        refused = '{"title": "No", "detail": "the proxy wants a password", "status": 403}'
        context.route("**/estop", lambda route: route.fulfill(status=403, body=refused))
        page.click("#estop")
        not_confirmed(seen, "it is refused: the proxy wants a password")
        context.unroute("**/estop")
        seen.until("#estop-words", "confirmed by the actuator", 10.0)
    assert len(desk.bus.trips) == 1
