"""Who can read the page and reach its controls: names, sizes, contrast; at a desk, on a tablet."""

from collections.abc import Generator

import pytest
from playwright.sync_api import Browser, ViewportSize

from tests.support.browser import DESK, TABLET, contrast, open_browser, origin_of, visit
from tests.support.running import RunningRig

CONTRAST = 4.5
"""WCAG 2 AA, for text."""
NAMELESS = """() => [...document.querySelectorAll('button, input, select, a, [tabindex="0"]')]
  .filter((each) => each.offsetParent !== null)
  .filter((each) => !(each.textContent.trim() || each.getAttribute('aria-label')
    || (each.labels && [...each.labels].some((label) => label.textContent.trim()))))
  .map((each) => each.outerHTML)"""
SMALL = """() => [...document.querySelectorAll('button, select, input[type=number], label.check')]
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


@pytest.fixture(scope="module")
def browser() -> Generator[Browser]:
    with open_browser() as opened:
        yield opened


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [DESK, TABLET], ids=["desk", "tablet"])
def test_everybody_can_read_and_reach_it(
    browser: Browser, rig: RunningRig, scheme: str, size: dict[str, int]
) -> None:
    context = browser.new_context(
        viewport=ViewportSize(width=size["width"], height=size["height"]),
        color_scheme="dark" if scheme == "dark" else "light",
    )
    try:
        seen = visit(context, origin_of(rig.rig))
        assert seen.page.evaluate(NAMELESS) == []
        assert seen.page.evaluate(SMALL) == []
        texts = seen.page.evaluate(TEXTS)
        assert len(texts) > 20
        pale = [text for text in texts if contrast(text[1], text[2]) < CONTRAST]
        assert pale == []
        wide = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
        assert seen.page.evaluate(wide) == 0
        box = seen.page.locator("#estop").bounding_box()
        assert box is not None
        seen.page.mouse.wheel(0, 4000)
        assert seen.page.locator("#estop").bounding_box() == box
        assert seen.page.locator("html").get_attribute("lang") == "en"
    finally:
        context.close()
