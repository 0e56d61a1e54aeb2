"""Accessibility of the page: names, sizes and contrast of its controls; on a desktop and on a
tablet."""

import pytest
from playwright.sync_api import Browser, ViewportSize

from tests.support.browser import (
    DESK,
    TABLETS,
    Visit,
    contrast,
    looked_at,
    origin_of,
    visit,
)
from tests.support.grips import make_ready
from tests.support.running import RunningRig

CONTRAST = 4.5
"""Minimum contrast of WCAG 2 AA for text."""
NAMELESS = """() => [...document.querySelectorAll('button, input, select, a, [tabindex="0"]')]
  .filter((each) => each.offsetParent !== null)
  .filter((each) => !(each.textContent.trim() || each.getAttribute('aria-label')
    || (each.labels && [...each.labels].some((label) => label.textContent.trim()))))
  .map((each) => each.outerHTML)"""
SMALL = """() => [...document.querySelectorAll(
    'button, select, textarea, input:not([type=checkbox]), label.check, summary')]
  .filter((each) => each.offsetParent !== null && each.getBoundingClientRect().height < 43.5)
  .map((each) => each.outerHTML)"""
TEXTS = """() => [...document.querySelectorAll('body *')]
  .filter((each) => each.offsetParent !== null && [...each.childNodes].some(
    (child) => child.nodeType === 3 && child.textContent.trim()))
  .map((each) => {
    let ground = each;
    while (ground && getComputedStyle(ground).backgroundColor === 'rgba(0, 0, 0, 0)') {
      ground = ground.parentElement;
    }
    return [each.outerHTML.slice(0, 80), getComputedStyle(each).color,
      getComputedStyle(ground ?? document.body).backgroundColor];
  })"""


GO = """() => ['start', 'dry-run'].every((id) => {
  const { top, bottom } = document.getElementById(id).getBoundingClientRect();
  return top >= 0 && bottom <= innerHeight;
})"""
WIDE = """() => Math.max(
  ...[document.documentElement, ...document.querySelectorAll('.side, .panel')]
  .map((each) => each.scrollWidth - each.clientWidth))"""


@pytest.fixture
def rig(browser: Browser, paced: RunningRig) -> RunningRig:
    assert browser.is_connected()
    make_ready(paced)
    return paced


def check(seen: Visit) -> None:
    """Check that every visible element has a name, is large enough, has contrast, and fits."""
    assert seen.page.evaluate(NAMELESS) == []
    assert seen.page.evaluate(SMALL) == []
    texts = seen.page.evaluate(TEXTS)
    assert len(texts) > 20
    assert [text for text in texts if contrast(text[1], text[2]) < CONTRAST] == []
    assert seen.page.evaluate(WIDE) == 0


@pytest.mark.parametrize(("scheme", "size"), [("light", DESK), *(("dark", one) for one in TABLETS)])
def test_the_page_is_readable_and_accessible(
    browser: Browser, rig: RunningRig, scheme: str, size: dict[str, int]
) -> None:
    context = browser.new_context(
        viewport=ViewportSize(width=size["width"], height=size["height"]),
        color_scheme="dark" if scheme == "dark" else "light",
    )
    try:
        seen = visit(context, origin_of(rig.rig))
        check(seen)
        seen.page.focus("#kind")
        assert seen.page.evaluate(GO)
        seen.page.select_option("#kind", "move")
        check(seen)
        assert seen.page.evaluate(GO)
        seen.page.click("#tab-rig")
        seen.until("#rig-model", "in use")
        check(seen)
        box = seen.page.locator("#estop").bounding_box()
        assert box is not None
        seen.page.mouse.wheel(0, 4000)
        assert seen.page.locator("#estop").bounding_box() == box
        assert seen.page.locator("html").get_attribute("lang") == "en"
    finally:
        context.close()


def test_a_dead_server_is_reported_with_the_age_of_the_displayed_values(
    browser: Browser, rig: RunningRig
) -> None:
    with looked_at(browser, rig.rig) as seen:
        seen.page.route("**/api/v1/**", lambda route: route.abort())
        seen.until("#stale", "The values shown are", 10.0)
        assert "E-STOP is kept and sent until the actuator confirms it" in seen.text("#stale")
        seen.until("#announce-alarm", "does not answer")
        assert seen.page.locator("#estop").is_enabled()
        seen.page.click("#start")
        seen.until("#start-said", "does not answer")
        seen.page.unroute_all(behavior="ignoreErrors")
        seen.until("#connection", "connected", 10.0)
        assert seen.page.locator("#stale").is_hidden()
        seen.errors.clear()


def test_keyboard_focus_follows_the_visible_order_of_controls(
    browser: Browser, rig: RunningRig
) -> None:
    """Tab moves down each column, and the focused element is marked."""
    with looked_at(browser, rig.rig) as seen:
        seen.until_true(lambda: seen.page.input_value("#field-force_mN") != "", "no defaults came")
        reached: list[str] = []
        while "dry-run" not in reached:
            seen.page.keyboard.press("Tab")
            reached.append(str(seen.page.evaluate("document.activeElement.id")))
            assert len(reached) < 40, reached
            outline = seen.page.evaluate(
                "getComputedStyle(document.activeElement).outlineStyle !== 'none'"
            )
            assert outline, reached[-1]
        wanted = [
            "estop",
            "freeze",
            "charts",
            "tab-start",
            "kind",
            "field-force_mN",
            "field-hold_s",
        ]
        assert [each for each in reached if each in [*wanted, "start", "dry-run"]] == [
            *wanted,
            "start",
            "dry-run",
        ]
