"""Numbers typed into the page: the meaning of each text, and refusals."""

import json
from collections.abc import Generator
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, Request, Route, ViewportSize

from tests.support.browser import DESK, Visit, visit
from tests.support.rigs import demo_rig
from tests.support.served import served
from tests.unit.supervisor.harness import Harness

LONG_S = 90.0
"""Time that a plan and its prediction may take on a busy machine."""
CASES = json.loads((Path(__file__).parents[1] / "data" / "numbers.json").read_text("utf-8"))
READ = """async ([name, texts]) => {
  const numbers = await import('./page/js/form/numbers.js');
  return texts.map((text) => { try { return numbers[name](text); } catch { return null; } });
}"""


@pytest.fixture
def seen(browser: Browser, tmp_path: Path) -> Generator[Visit]:
    """The page of a canned rig."""
    context = browser.new_context(viewport=ViewportSize(**DESK))
    desk = Harness(demo_rig(time="lockstep"), tmp_path)
    with served(desk.app) as address:
        yield visit(context, address)
        context.close()
    desk.close()


@pytest.mark.parametrize(("kind", "reader"), [("single", "numberIn"), ("list", "numbersIn")])
def test_every_number_format_of_the_common_table_is_parsed_as_specified(
    seen: Visit, kind: str, reader: str
) -> None:
    cases = CASES[kind]
    read = seen.page.evaluate(READ, [reader, [text for text, _ in cases]])
    found = dict(zip([text for text, _ in cases], read, strict=True))
    assert found == dict(cases)


def requests_of(seen: Visit) -> list[Request]:
    """Return the requests for a plan or a job as they are sent."""
    found: list[Request] = []
    seen.page.on("request", lambda request: found.append(request) if wanted(request) else None)
    return found


def wanted(request: Request) -> bool:
    defaults = "predict=false" in request.url
    return request.method == "POST" and "/jobs" in request.url and not defaults


@pytest.mark.parametrize(
    ("typed", "sent", "words"),
    [("2,5", 2.5, "= 2.5 mN"), ("12", 12.0, "")],
)
def test_the_number_that_is_shown_is_the_number_that_is_sent(
    seen: Visit, typed: str, sent: float, words: str
) -> None:
    found = requests_of(seen)
    seen.page.fill("#field-force_mN", typed)
    assert seen.page.inner_text("#field-force_mN-read") == words
    seen.page.click("#dry-run")
    seen.until("#plan-sent", f"{sent:g} mN")
    assert [(request.post_data_json or {})["force_mN"] for request in found] == [sent]


REFUSED = [
    ("grip", "force_mN", ["5e", "1,000", "1.000,5", "0x10", "Infinity"]),
    ("grip", "hold_s", ["--5", "\uff15"]),
    ("move", "value", ["1 000", ""]),
    ("track", "points", ["0,5\n1 2", "0 5 1"]),
]


def test_a_text_that_is_not_a_number_is_refused_at_its_field_and_nothing_is_sent(
    seen: Visit,
) -> None:
    found = requests_of(seen)
    for kind, place, texts in REFUSED:
        seen.page.select_option("#kind", kind)
        field = seen.page.locator(f"#field-{place}")
        if not field.is_visible():
            choose_shape(seen, place)
        for typed in texts:
            field.fill(typed)
            for button in ("#dry-run", "#start"):
                seen.page.click(button)
                seen.until_true(
                    lambda place=place: seen.text(f"#field-{place}-fault") != "",
                    f"{typed!r} was not refused",
                )
                assert field.get_attribute("aria-invalid") == "true"
                assert field.input_value() == typed
    seen.page.wait_for_timeout(200)
    assert found == []


def choose_shape(seen: Visit, place: str) -> None:
    """Choose the shape of a path that has a field."""
    shapes = seen.page.locator("#start-form select").all()
    for select in shapes:
        for value in select.evaluate("e => [...e.options].map((each) => each.value)"):
            if select.get_attribute("id") != "kind" and select.is_visible():
                select.select_option(value)
                if seen.page.locator(f"#field-{place}").is_visible():
                    return
    raise AssertionError(f"no shape has the field {place}")


@pytest.mark.parametrize(
    ("member", "name", "low"), [("points", "force_mN", 5.0), ("x_points", "x_um", 33.0)]
)
def test_a_path_from_a_file_is_stored_once_by_its_digest(
    seen: Visit, tmp_path: Path, member: str, name: str, low: float
) -> None:
    points = [{"t_s": 0.25 * number, name: low + 0.125 * (number % 2)} for number in range(8)]
    lines = [f"{one['t_s']};{one[name]}".replace(".", ",") for one in points]
    file, field = tmp_path / "path.csv", f"#field-{member}"
    file.write_text(f"t_s;{name}\n0;x\n", encoding="utf-8")
    seen.page.select_option("#kind", "track")
    seen.page.select_option("#field-shape", "waypoints")
    seen.page.set_input_files(f"{field}-file", file)
    seen.until(f"{field}-fault", f"line 2: {name} = 'x'")
    file.write_text("\n".join([f"t_s;{name}", *lines]), encoding="utf-8")
    seen.page.set_input_files(f"{field}-file", file)
    seen.until_true(
        lambda: seen.page.input_value(field).count("\n") == len(points) - 1,
        "the rows were not displayed",
        LONG_S,
    )
    seen.page.fill("#field-sample", "B7")
    seen.page.click("#start")
    api = f"{seen.origin}/api/v1"
    seen.until_true(
        lambda: [job["sample"] for job in httpx.get(f"{api}/jobs").json()["jobs"]] == ["B7"],
        "no job was created and displayed",
        LONG_S,
    )
    assert httpx.get(f"{api}/jobs").json()["jobs"][0]["request"][member] == points
    (kept,) = httpx.get(f"{api}/trajectories").json()["trajectories"]
    again = httpx.post(f"{api}/trajectories", json=kept["request"], timeout=LONG_S)
    assert (again.status_code, again.json()["digest"]) == (200, kept["digest"])


def test_wheel_and_arrow_keys_change_no_value(seen: Visit) -> None:
    field = seen.page.locator("#field-force_mN")
    field.fill("15")
    field.hover()
    seen.page.mouse.wheel(0, 300)
    for key in ("ArrowUp", "ArrowDown", "PageUp", "PageDown"):
        seen.page.keyboard.press(key)
    assert field.input_value() == "15"
    assert seen.page.locator("input[type=number], input[type=date]").count() == 0


def test_a_number_typed_while_the_defaults_load_is_kept(seen: Visit) -> None:
    held: list[Route] = []
    seen.page.route("**/jobs?dry_run=true&predict=false", lambda route: held.append(route))
    seen.page.reload()
    seen.until_true(lambda: bool(held), "no defaults were requested")
    seen.page.fill("#field-force_mN", "3,5")
    seen.page.locator("#field-force_mN").blur()
    for route in held:
        route.continue_()
    seen.page.unroute_all()
    seen.page.wait_for_timeout(1000)
    assert seen.page.input_value("#field-force_mN") == "3,5"
    assert seen.text("#field-force_mN-read") == "= 3.5 mN"
