"""The charts of the page: errors with the tolerance, hours of the records, a camera beside them."""

import re
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import Any, Literal

import httpx
import pytest
from playwright.sync_api import Browser, Route, ViewportSize

from tests.support.browser import DESK, Visit, visit
from tests.support.cameras import camera, mjpeg, painted
from tests.support.rigs import demo_rig
from tests.support.served import served
from tests.support.two_arms import two_arm_rig
from tests.system.test_page_search import gripped
from tests.unit.supervisor.harness import Harness

PHONE = {"width": 390, "height": 844}
PATIENCE_S = 120.0
"""Time that the page may need on a busy machine, in s."""
OVERLAPS = """() => {
  const words = [...document.querySelectorAll('h1, h2, th, td, dt, dd, figcaption > *, button, p')]
    .filter((each) => each.offsetParent !== null && each.textContent.trim()
      && !each.closest('.unseen, .stacked thead') && !each.querySelector('button, p, th, td, dd'));
  const boxes = words.map((each) => [each, each.getBoundingClientRect()]);
  const found = [];
  for (const [one, a] of boxes) for (const [other, b] of boxes) {
    if (one === other || one.contains(other) || other.contains(one)) continue;
    // The bar and the buttons of the form stay in sight while the rest passes below them.
    if (one.closest('.bar, .go') !== other.closest('.bar, .go')) continue;
    if (a.left < b.right - 1 && b.left < a.right - 1
      && a.top < b.bottom - 1 && b.top < a.bottom - 1) {
      found.push(`${one.textContent.trim()} / ${other.textContent.trim()}`);
    }
  }
  return found;
}"""


def strips(seen: Visit) -> list[str]:
    """Return the names of the visible strips."""
    return [
        strip.get_attribute("data-quantity") or ""
        for strip in seen.page.locator(".strip").all()
        if strip.is_visible()
    ]


def test_errors_are_shown_with_the_tolerance_of_the_job(browser: Browser, desk: Harness) -> None:
    context = browser.new_context()
    with served(desk.app) as address:
        gripped(address, "B7", force_tolerance_mN=0.8)
        seen = visit(context, address)
        assert strips(seen) == ["x_um", "force_mN", "voltage_V"]
        seen.page.click("#expert")
        assert strips(seen)[-1] == "sliding_um"
        seen.page.click("#shows [data-shows=errors]")
        assert strips(seen) == ["x_error_um", "force_error_mN", "voltage_V", "sliding_um"]
        seen.until("[data-quantity=force_error_mN]", "tolerance of the job, ± 0.80")
        assert "tolerance" not in seen.text("[data-quantity=x_error_um]")
        seen.until("#readouts", "tolerance ± 0.80")
        assert seen.errors == []
    context.close()


DRAW_BOTH = """async () => {
  const { QUANTITIES, Strip } = await import(new URL("page/js/plots/strip.js", document.baseURI));
  const { palette } = await import(new URL("page/js/plots/axes.js", document.baseURI));
  const strip = new Strip(QUANTITIES[0]);
  strip.element.style.cssText = "position: fixed; inset: 0; width: 300px; height: 200px";
  document.body.append(strip.element);
  strip.settle({ first: true, last: true, both: true });
  const source = { count: 100, since: (t) => Math.max(0, Math.min(100, Math.ceil(t * 10))),
    time: (i) => i / 10, value: (name) => ({ x_um: 1, second_x_um: 5 }[name] ?? NaN),
    gap: () => false, part: () => "", phase: () => "", hue: () => undefined };
  const colours = palette();
  strip.draw(source, { from: 0, to: 10, seconds: 10, cross: null }, colours);
  const { width, height } = strip.canvas;
  const { data } = strip.canvas.getContext("2d").getImageData(0, 0, width, height);
  strip.element.remove();
  return [colours.measured, colours.second].map((colour) => {
    const wanted = [1, 3, 5].map((place) => parseInt(colour.slice(place, place + 2), 16));
    let found = 0;
    for (let i = 0; i < data.length; i += 4) {
      if (wanted.every((part, k) => Math.abs(data[i + k] - part) < 12)) found += 1;
    }
    return found > 100;
  });
}"""
"""Draw a chart of both arms; return whether the colour of each arm is in it."""


@pytest.mark.parametrize(("scheme", "width"), [("light", 1280), ("dark", 400)])
def test_both_arms_of_a_quantity_share_a_chart_inside_the_card(
    browser: Browser, tmp_path: Path, scheme: Literal["light", "dark"], width: int
) -> None:
    desk = Harness(two_arm_rig(), tmp_path)
    size: ViewportSize = {"width": width, "height": 800}
    context = browser.new_context(viewport=size, color_scheme=scheme)
    try:
        with served(desk.app) as address:
            seen = visit(context, address)
            seen.until("[data-quantity=x_um] .key.second", "arm 2", PATIENCE_S)
            assert strips(seen) == ["x_um", "force_mN", "place_um", "voltage_V"]
            captions = [seen.text(f"[data-quantity={name}] figcaption") for name in strips(seen)]
            assert ["arm 1" in text and "arm 2" in text for text in captions] == [
                True,
                True,
                False,
                True,
            ]
            names = seen.page.locator("#readouts tr:visible th").all_inner_texts()
            assert names == [
                "Position, arm 1",
                "Position, arm 2",
                "Contact force, arm 1",
                "Contact force, arm 2",
                "Place",
                "Voltage, arm 1",
                "Voltage, arm 2",
            ]
            # A notice that the supervisor is slow makes the page shorter for a while.
            seen.until_true(
                lambda: bottom_of(seen, ".strip.last canvas") <= bottom_of(seen, ".scope"),
                "the last chart is outside its card",
                PATIENCE_S,
            )
            heights = [
                strip.bounding_box() or {"height": 0.0}
                for strip in seen.page.locator(".strip:visible canvas").all()
            ]
            assert min(box["height"] for box in heights) >= 50.0
            assert seen.page.evaluate(DRAW_BOTH) == [True, True]
            seen.page.click("#window [data-seconds='3600']")
            seen.until("#scope-title", "Records", PATIENCE_S)
            captions = seen.page.locator(".strip:visible").all_inner_texts()
            assert not [text for text in captions if "arm 2" in text]
            assert strips(seen) == ["x_um", "force_mN", "voltage_V"]
            assert seen.errors == []
    finally:
        context.close()
        desk.close()


def bottom_of(seen: Visit, selector: str) -> float:
    """Return the lower edge of the last visible element of a selector, in pixels."""
    box = seen.page.locator(selector).locator("visible=true").last.bounding_box()
    assert box is not None
    return box["y"] + box["height"]


COLOURED = """() => {
  const canvas = document.querySelector("[data-quantity=force_mN] canvas");
  const copy = new OffscreenCanvas(canvas.width, canvas.height);
  // Chromium warns of canvases that are read again and again without this.
  const context = copy.getContext("2d", { willReadFrequently: true });
  context.drawImage(canvas, 0, 0);
  const { data } = context.getImageData(0, 0, copy.width, copy.height);
  for (let i = 0; i < data.length; i += 4) {
    const [red, green, , alpha] = data.slice(i, i + 4);
    if (alpha > 20 && alpha < 40 && green > red + 80) return true;
  }
  return false;
}"""
"""Script that returns whether the force chart shows the pale green of a succeeded job."""


WRITTEN = """window.written = [];
const write = CanvasRenderingContext2D.prototype.fillText;
CanvasRenderingContext2D.prototype.fillText = function (text, ...rest) {
  window.written.push(text);
  write.call(this, text, ...rest);
};"""
"""Script that stores the texts drawn on canvases in ``written``."""


def until_written(seen: Visit, act: Callable[[], None], pattern: str) -> None:
    """Do something and wait until a chart shows a text."""
    seen.page.evaluate("window.written = []")
    act()
    seen.until_true(
        lambda: bool(
            seen.page.evaluate(f"window.written.some((text) => /^{pattern}$/.test(text))")
        ),
        f"no chart shows {pattern}",
        PATIENCE_S,
    )


def drag(seen: Visit, canvas: str, begin: float, end: float) -> None:
    """Drag over a chart, from one share of its width to another."""
    box = seen.page.locator(canvas).bounding_box()
    assert box is not None
    y = box["y"] + box["height"] / 2
    seen.page.mouse.move(box["x"] + begin * box["width"], y)
    seen.page.mouse.down()
    seen.page.mouse.move(box["x"] + end * box["width"], y, steps=4)
    seen.page.mouse.up()


@pytest.mark.parametrize("seconds", ["30", "3600"])
def test_dragging_over_a_chart_zooms(browser: Browser, desk: Harness, seconds: str) -> None:
    context = browser.new_context(viewport=ViewportSize(**DESK))
    context.add_init_script(WRITTEN)
    with served(desk.app) as address:
        gripped(address, "B7")
        seen = visit(context, address)
        clock, nearer = (
            (r"\d\d:\d\d", r"\d\d:\d\d:\d\d")
            if seconds == "3600"
            else (r"\d\d:\d\d:\d\d", r"\d+\.\d+ s")
        )
        window = f"#window [data-seconds='{seconds}']"
        until_written(seen, lambda: seen.page.click(window), clock)
        until_written(
            seen, lambda: drag(seen, "[data-quantity=force_mN] canvas", 0.9, 0.95), nearer
        )
        until_written(seen, lambda: seen.page.click("#zoom-out"), clock)
        assert seen.page.is_hidden("#zoom-out")
        assert seen.errors == []
    context.close()


def swipe(seen: Visit, canvas: str, begin: tuple[float, float], end: tuple[float, float]) -> None:
    """Move a finger over a chart; both points are shares of its width and height."""
    box = seen.page.locator(canvas).bounding_box()
    assert box is not None
    session: Any = seen.page.context.new_cdp_session(seen.page)

    def touch(kind: str, *shares: tuple[float, float]) -> None:
        points = [
            {"x": box["x"] + x * box["width"], "y": box["y"] + y * box["height"]} for x, y in shares
        ]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    steps = [step / 8 for step in range(9)]
    path = [tuple(a + step * (b - a) for a, b in zip(begin, end, strict=True)) for step in steps]
    touch("touchStart", (path[0][0], path[0][1]))
    for x, y in path[1:]:
        touch("touchMove", (x, y))
    touch("touchEnd")


def test_a_finger_zooms_sideways_and_scrolls_upwards(browser: Browser, desk: Harness) -> None:
    context = browser.new_context(viewport=ViewportSize(**PHONE), has_touch=True, is_mobile=True)
    canvas = "[data-quantity=force_mN] canvas"
    with served(desk.app) as address:
        gripped(address, "B7")
        seen = visit(context, address)
        seen.page.locator(canvas).scroll_into_view_if_needed()
        before = seen.page.evaluate("scrollY")
        swipe(seen, canvas, (0.5, 0.8), (0.5, 0.1))
        seen.until_true(
            lambda: seen.page.evaluate("scrollY") != before, "the page did not scroll", PATIENCE_S
        )
        assert seen.page.is_hidden("#zoom-out")
        seen.page.locator(canvas).scroll_into_view_if_needed()
        swipe(seen, canvas, (0.9, 0.5), (0.6, 0.5))
        seen.until_true(lambda: seen.page.is_visible("#zoom-out"), "it did not zoom", PATIENCE_S)
        assert seen.errors == []
    context.close()


COMPARED = """() => {
  const canvas = document.querySelector("#comparison [data-compared=force_mN] canvas");
  const copy = new OffscreenCanvas(canvas.width, canvas.height);
  const context = copy.getContext("2d", { willReadFrequently: true });
  context.drawImage(canvas, 0, 0);
  const { data } = context.getImageData(0, 0, copy.width, copy.height);
  const style = getComputedStyle(document.documentElement);
  return ["--measured", "--reference"].map((name) => {
    const colour = style.getPropertyValue(name).trim();
    const wanted = [1, 3, 5].map((place) => parseInt(colour.slice(place, place + 2), 16));
    const is = (i) => wanted.every((part, k) => Math.abs(data[i + k] - part) < 12);
    let found = 0;
    for (let i = 0; i < data.length; i += 4) {
      if (data[i + 3] > 200 && is(i)) found += 1;
    }
    return found > 10;
  });
}"""
"""Script that returns whether the force chart of a comparison has the colours of the first two
jobs."""


@pytest.mark.parametrize("size", [PHONE, DESK])
def test_two_jobs_are_compared_in_one_chart(
    browser: Browser, desk: Harness, size: ViewportSize
) -> None:
    context = browser.new_context(viewport=size)
    with served(desk.app) as address:
        jobs = [gripped(address, f"B{force_mN}", force_mN=force_mN) for force_mN in (6, 12)]
        seen = visit(context, address)
        seen.page.click("#tab-jobs")
        for job in jobs:
            assert seen.page.is_disabled("#compare")
            seen.page.check(f"#pick-{job}")
        seen.page.click("#compare")
        seen.until("#comparison", "B12", PATIENCE_S)
        texts = seen.page.locator("#comparison li").all_inner_texts()
        assert ["B6" in texts[0], "B12" in texts[1]] == [True, True]
        seen.until_true(lambda: seen.page.evaluate(COMPARED) == [True, True], "no lines")
        assert seen.page.is_hidden("#charts")
        drag(seen, "#comparison [data-compared=force_mN] canvas", 0.5, 0.7)
        seen.until("#comparison [data-compared=force_mN] output", "mN at ")
        seen.page.click("#comparison-whole")
        assert seen.page.evaluate(OVERLAPS) == []
        seen.page.click("#comparison-close")
        assert seen.page.is_visible("#charts")
        assert seen.errors == []
    context.close()


def test_a_finger_zooms_a_comparison_and_its_title_is_below_the_bar(
    browser: Browser, desk: Harness
) -> None:
    context = browser.new_context(viewport=ViewportSize(**PHONE), has_touch=True, is_mobile=True)
    canvas = "#comparison [data-compared=force_mN] canvas"
    with served(desk.app) as address:
        jobs = [gripped(address, f"B{force_mN}", force_mN=force_mN) for force_mN in (6, 12)]
        seen = visit(context, address)
        # The alarm makes the bar higher.
        seen.page.click("#estop")
        seen.until("#alarm-head", "emergency stop", PATIENCE_S)
        seen.page.click("#tab-jobs")
        for job in jobs:
            seen.page.check(f"#pick-{job}")
        seen.page.click("#compare")
        seen.until("#comparison", "B12", PATIENCE_S)
        title = seen.page.locator("#comparison-title").bounding_box()
        assert title is not None
        assert title["y"] >= bottom_of(seen, ".bar")
        assert seen.page.is_hidden("#comparison-whole")
        seen.page.locator(canvas).scroll_into_view_if_needed()
        swipe(seen, canvas, (0.4, 0.5), (0.8, 0.5))
        seen.until_true(
            lambda: seen.page.is_visible("#comparison-whole"), "it did not zoom", PATIENCE_S
        )
        before = seen.page.evaluate("scrollY")
        swipe(seen, canvas, (0.5, 0.8), (0.5, 0.1))
        seen.until_true(
            lambda: seen.page.evaluate("scrollY") != before, "the page did not scroll", PATIENCE_S
        )
        assert seen.errors == []
    context.close()


HEIGHTS_OF_FIRST = """() => {
  const canvas = document.querySelector("#comparison [data-compared=force_mN] canvas");
  const { width, height } = canvas;
  const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
  const colour = getComputedStyle(document.documentElement).getPropertyValue("--measured").trim();
  const wanted = [1, 3, 5].map((place) => parseInt(colour.slice(place, place + 2), 16));
  const rows = new Set();
  for (let i = 0; i < data.length; i += 4) {
    if (data[i + 3] > 200 && wanted.every((part, k) => Math.abs(data[i + k] - part) < 12)) {
      rows.add(Math.floor(i / 4 / width / height * 10));
    }
  }
  return [...rows].length;
}"""
"""Script that returns how many tenths of the height of the force chart have the colour of the
first job."""


def test_both_arms_of_a_job_are_drawn_in_the_comparison(browser: Browser, desk: Harness) -> None:
    context = browser.new_context(viewport=ViewportSize(**DESK))

    def history(route: Route) -> None:
        found = route.fetch().json()
        found["at_s"] = [found["from_s"] + 0.1 * i for i in range(20)]
        for side in ("low", "high"):
            found[side] = {"force_mN": [5.0] * 20, "second_force_mN": [15.0] * 20}
        route.fulfill(json=found)

    context.route(re.compile(r"/history\?job="), history)
    with served(desk.app) as address:
        job = gripped(address, "B7")
        seen = visit(context, address)
        seen.page.click("#tab-jobs")
        seen.page.click(f"#open-{job}")
        seen.page.click("text=Show in the charts")
        seen.until("#comparison", "arm 2", PATIENCE_S)
        seen.until_true(lambda: seen.page.evaluate(HEIGHTS_OF_FIRST) == 2, "not two lines")
        captions = seen.page.locator("#comparison figcaption").all_inner_texts()
        assert ["arm 2" in text for text in captions] == [False, True, False]
        assert seen.errors == []
    context.close()


def test_missing_content_is_shown_as_loading(browser: Browser, desk: Harness) -> None:
    context = browser.new_context()
    held: list[Route] = []
    context.route(re.compile(r"/history\?|/jobs\?.*limit=30"), lambda route: held.append(route))
    with served(desk.app) as address:
        seen = visit(context, address)
        seen.page.click("#window [data-seconds='3600']")
        seen.until("#age", "loading …")
        seen.page.click("#tab-jobs")
        assert seen.text("#job-list") == "loading …"
    context.close()


def test_long_plots_are_drawn_from_the_records(browser: Browser, desk: Harness) -> None:
    context = browser.new_context()
    with served(desk.app) as address:
        gripped(address, "B7")
        seen = visit(context, address)
        seen.page.click("#window [data-seconds='3600']")
        seen.until("#scope-title", "Records")
        read = "async () => (await (await fetch('/api/v1/rigs/demo/history?hours=1')).json())"
        found = seen.page.evaluate(read)
        assert [job["kind"] for job in found["jobs"]] == ["grip"]
        assert found["jobs"][0]["recorded"]
        assert max(value for value in found["high"]["force_mN"] if value is not None) > 5.0
        seen.until_true(lambda: seen.page.evaluate(COLOURED), "the job has no colour")
        seen.page.focus("#charts")
        seen.page.keyboard.press("ArrowRight")
        seen.until("#at", "grip")
        seen.until("[data-quantity=force_mN] .strip-said", "mN")
        seen.page.click("#window [data-seconds='10']")
        seen.until("#scope-title", "Live")
        assert seen.errors == []
    context.close()


def test_a_camera_picture_is_shown_next_to_the_charts(browser: Browser, tmp_path: Path) -> None:
    context = browser.new_context()
    requested: list[str] = []
    send = mjpeg(painted("red"), painted("green"))

    def noted(handler: BaseHTTPRequestHandler) -> None:
        requested.append(handler.path)
        send(handler)

    with camera(noted) as stream:
        desk = Harness(demo_rig({"supervisor": {"camera": stream}}, time="lockstep"), tmp_path)
        with served(desk.app) as address:
            seen = visit(context, address)
            seen.page.wait_for_selector("#camera-picture")
            seen.until_true(
                lambda: (
                    seen.page.evaluate("document.getElementById('camera-picture').naturalWidth")
                    == 320
                ),
                "no picture came",
            )
            picture = seen.page.locator("#camera").bounding_box()
            chart = seen.page.locator("[data-quantity=force_mN]").bounding_box()
            assert picture is not None
            assert chart is not None
            assert picture["x"] >= chart["x"] + chart["width"]
            assert picture["y"] < chart["y"] + chart["height"]
            assert chart["y"] < picture["y"] + picture["height"]
            assert set(requested) == {"/stream"}
            assert {each for each in seen.foreign() if not each.startswith("data:")} == {stream}
            assert seen.errors == []
        desk.close()
    context.close()


def test_one_event_is_shown_in_one_notice(browser: Browser, desk: Harness) -> None:
    context = browser.new_context()
    with served(desk.app) as address:
        seen = visit(context, address)
        seen.page.click("#estop")
        seen.until("#estop-said", "confirmed by the actuator")
        seen.until("#latch", "emergency stop")
        assert seen.page.locator("#reasons").is_hidden()
        stated, latch = (
            seen.page.locator(place).bounding_box() for place in ("#estop-said", "#latch")
        )
        assert stated is not None
        assert latch is not None
        assert stated["y"] + stated["height"] == pytest.approx(latch["y"], abs=1.0)
        grounds = [
            seen.page.locator(place).evaluate("each => getComputedStyle(each).backgroundColor")
            for place in ("#estop-said", "#latch")
        ]
        assert grounds[0] == grounds[1]
    context.close()


@pytest.mark.parametrize("size", [PHONE, DESK])
def test_bar_and_tabs_have_plain_labels(
    browser: Browser, desk: Harness, size: ViewportSize
) -> None:
    context = browser.new_context(viewport=size)
    with served(desk.app) as address:
        seen = visit(context, address)
        estop = seen.page.locator("#estop").bounding_box()
        assert "Model of the arm\nvalues of the rig file" in seen.text("#facts")
        seen.page.click("#estop")
        seen.until("#latch-cause", "Do not move the gripper's stage until then", PATIENCE_S)
        assert "Gripper's stage\n▲do not move" in seen.text("#facts")
        seen.until("#tab-rig", "Rig (1 alarm)", PATIENCE_S)
        seen.until("#alarm-head", "emergency stop", PATIENCE_S)
        assert seen.page.locator("#estop").bounding_box() == estop
        assert seen.page.evaluate(OVERLAPS) == []
        seen.page.click("#alarm-head button")
        seen.page.wait_for_selector("#alarm-head", state="hidden")
        (alarm,) = httpx.get(f"{address}/api/v1/alarms").json()["alarms"]
        assert alarm["acknowledged_by"]
    context.close()


def test_nothing_overlaps_on_a_narrow_screen(browser: Browser, desk: Harness) -> None:
    context = browser.new_context(viewport=ViewportSize(**PHONE), has_touch=True, is_mobile=True)
    with served(desk.app) as address:
        gripped(address, "B7")
        seen = visit(context, address)
        assert not seen.page.is_visible("#estop-hint"), "a phone has no Escape key"
        seen.page.click("#tab-jobs")
        seen.page.wait_for_selector("#job-list .time")
        assert seen.page.evaluate(OVERLAPS) == []
        assert (
            seen.page.evaluate(
                "document.documentElement.scrollWidth - document.documentElement.clientWidth"
            )
            == 0
        )
        heights = seen.page.evaluate(
            "[...document.querySelectorAll('#job-list .time button')].map((each) => "
            "{ const all = document.createRange(); all.selectNodeContents(each);"
            " return all.getClientRects().length; })"
        )
        assert set(heights) == {1}, "a time wraps"
        scope = seen.page.locator(".scope").bounding_box()
        last = seen.page.locator("#charts .strip:not([hidden])").last.bounding_box()
        assert scope is not None
        assert last is not None
        assert last["y"] + last["height"] <= scope["y"] + scope["height"]
    context.close()
