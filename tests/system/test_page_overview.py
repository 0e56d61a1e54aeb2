"""The page at every width: *All rigs*, one row per rig, and the tabs, complete in both colour
schemes."""

from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Literal

import httpx
import pytest
from playwright.sync_api import Browser, ViewportSize

from tests.support.browser import DESK, Visit, keep_picture, visit
from tests.support.rigs import demo_rig
from tests.support.served import served
from tests.system.test_page_search import gripped
from tests.unit.supervisor.canned import IN_HOLD
from tests.unit.supervisor.harness import Harness
from tests.unit.supervisor.rigs_harness import RigsHarness, joined

NAMES = ("bench", "bench-left", "chamber-2", "teaching")
PHONE = {"width": 390, "height": 844}
WIDE = {"width": 1400, "height": 900}
OVERLAPS = """() => {
  const cells = [...document.querySelectorAll("#overview th, #overview td, #overview h2")];
  const boxes = cells.map((each) => [each.innerText, each.getBoundingClientRect()]);
  const apart = (a, b) => a.left >= b.right - 1 || b.left >= a.right - 1
    || a.top >= b.bottom - 1 || b.top >= a.bottom - 1;
  const found = cells.filter((each) => each.scrollWidth - each.clientWidth > 1)
    .map((each) => `cut: ${each.innerText}`);
  for (const [i, [one, a]] of boxes.entries())
    found.push(...boxes.slice(i + 1).filter(([, b]) => !apart(a, b))
      .map(([other]) => `${one} over ${other}`));
  return found;
}"""
SPREADS = """() => [...document.querySelectorAll("#overview td > *")].map((each) => {
  const all = document.createRange();
  all.selectNodeContents(each);
  const bottoms = [...all.getClientRects()].map((one) => one.bottom);
  return bottoms.length ? Math.max(...bottoms) - Math.min(...bottoms) : 0;
})"""
ONE_LINE_PX = 12
"""Largest distance between the bottoms of a mark and of a word on the same line, in pixels."""
PATIENCE_S = 120.0
"""Time that the supervisor may need on a busy machine, in s."""
LONGER = "document.documentElement.scrollHeight - innerHeight"
WIDER = "document.documentElement.scrollWidth - document.documentElement.clientWidth"


@pytest.fixture
def desk(browser: Browser, tmp_path: Path) -> Generator[RigsHarness]:
    """Start four rigs: one holds a part, one has tripped, two are as after their start."""
    assert browser.is_connected()
    own = demo_rig({"rig": {"name": NAMES[0]}}, time="lockstep")
    desk = RigsHarness(own, tmp_path)

    def made() -> None:
        for name in NAMES[1:]:
            desk.come(joined(own, name))
            desk.served(name)
        desk.at(NAMES[0])
        desk.playing_to(IN_HOLD, rig=NAMES[0])
        desk.at(NAMES[1])
        desk.ended(desk.grip(rig=NAMES[1])["id"])
        desk.bus.trip("command_age")

    with ThreadPoolExecutor(1) as aside:  # the browser uses this thread's event loop
        aside.submit(made).result()
    yield desk
    desk.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [DESK, PHONE], ids=["desk", "phone"])
def test_all_rigs_are_in_one_table_without_overlap(
    browser: Browser,
    desk: RigsHarness,
    pictures: Path,
    scheme: Literal["light", "dark"],
    size: dict[str, int],
) -> None:
    viewport = ViewportSize(width=size["width"], height=size["height"])
    context = browser.new_context(viewport=viewport, color_scheme=scheme)
    with served(desk.app) as address:
        seen = visit(context, address)
        seen.page.click("#overview-open")
        seen.until(f"#overview-{NAMES[0]}", "hold")
        seen.until(f"#overview-{NAMES[1]}", "latched")
        wide = "desk" if size is DESK else "phone"
        keep_picture(seen, pictures, f"rigs-{wide}-{scheme}")
        whole(seen)
        rows = seen.page.locator("#overview tbody tr").all_inner_texts()
        assert len(rows) == len(NAMES)
        assert seen.errors == []
    context.close()


def whole(seen: Visit) -> None:
    """Check that nothing of the table is cut off or covered, and that the page has no horizontal
    scroll bar."""
    assert seen.page.evaluate(OVERLAPS) == []
    assert seen.page.evaluate(WIDER) <= 0
    assert max(seen.page.evaluate(SPREADS)) < ONE_LINE_PX, "a word is broken"


@pytest.mark.parametrize("size", [DESK, PHONE], ids=["desk", "phone"])
def test_no_tab_makes_the_page_wider_or_longer_than_its_window(
    browser: Browser, desk: RigsHarness, size: dict[str, int]
) -> None:
    context = browser.new_context(viewport=ViewportSize(width=size["width"], height=size["height"]))
    with served(desk.app) as address:
        seen = visit(context, address, f"?rig={NAMES[1]}")
        for tab, content in (
            ("jobs", "#job-list tbody tr"),
            ("calibrations", "#checklist tbody tr"),
            ("rig", "#rig-checks tbody tr"),
        ):
            seen.page.click(f"#tab-{tab}")
            seen.page.wait_for_selector(content)
            assert seen.page.evaluate(WIDER) <= 0, tab
        seen.page.click("#tab-jobs")
        seen.page.click("#job-list tbody button")
        seen.page.wait_for_selector("#job-said")
        assert seen.page.evaluate(WIDER) <= 0
        if size is DESK:
            assert seen.page.evaluate(LONGER) <= 0
    context.close()


BROKEN_WORDS = """() => {
  const found = [];
  const cells = document.querySelectorAll(".list :is(th, td), .figures-list :is(dt, dd)");
  for (const cell of cells) {
    const walker = document.createTreeWalker(cell, NodeFilter.SHOW_TEXT);
    while (walker.nextNode()) {
      for (const word of walker.currentNode.data.matchAll(/[^\\s-]+/g)) {
        if (word[0].length > 30) continue;  // a path may be longer than a line
        const range = document.createRange();
        range.setStart(walker.currentNode, word.index);
        range.setEnd(walker.currentNode, word.index + word[0].length);
        const tops = [...range.getClientRects()].map(({ top }) => Math.round(top));
        if (new Set(tops).size > 1) found.push(word[0]);
      }
    }
    const mark = cell.querySelector(".mark");
    if (mark?.offsetParent && mark.textContent) {
      const word = document.createRange();
      word.selectNodeContents(mark.nextSibling);
      if (word.getClientRects()[0].top > mark.getBoundingClientRect().bottom) {
        found.push(`mark of ${mark.nextSibling.data}`);
      }
    }
  }
  return found;
}"""
"""Script that returns the words of tables that continue on a further line, and the marks without
their word."""


@pytest.mark.parametrize("size", [WIDE, PHONE], ids=["wide", "phone"])
def test_no_word_of_a_table_is_broken(
    browser: Browser, tmp_path: Path, size: dict[str, int]
) -> None:
    desk = Harness(demo_rig(time="lockstep"), tmp_path)
    context = browser.new_context(viewport=ViewportSize(width=size["width"], height=size["height"]))
    try:
        with served(desk.app) as address:
            labels = {"series": "20261129-222014-fc54", "series_job": "2"}
            job = gripped(address, "B7", batch="tray-2026-11", labels=labels)
            httpx.post(f"{address}/api/v1/estop", timeout=PATIENCE_S).raise_for_status()
            seen = visit(context, address)
            for tab, content in (
                ("jobs", f"#open-{job}"),
                ("calibrations", "#checklist tbody tr"),
                ("rig", "#alarms tbody tr"),
                ("rig", "#rig-programs tbody tr"),
                ("rig", "#rig-checks tbody tr"),
            ):
                seen.page.click(f"#tab-{tab}")
                seen.page.wait_for_selector(content)
                assert seen.page.evaluate(BROKEN_WORDS) == [], tab
                assert seen.page.evaluate(WIDER) <= 0, tab
            seen.page.click("#tab-jobs")
            seen.page.click(f"#open-{job}")
            seen.page.wait_for_selector(".figures-list dd")
            assert seen.page.evaluate(BROKEN_WORDS) == []
    finally:
        context.close()
        desk.close()
