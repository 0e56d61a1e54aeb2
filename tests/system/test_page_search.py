"""A job of yesterday is found on the page by its sample, with its picture and its force."""

from datetime import datetime
from pathlib import Path
from typing import Any

import httpx
from playwright.sync_api import Browser, ViewportSize

from pincette.client import Supervisor
from pincette_supervisor.journal.database import Database
from tests.support.browser import DESK, keep_picture, visit
from tests.support.served import served
from tests.unit.supervisor.harness import Harness

TO_THE_TOP = "e => { e.closest('.side').scrollTop += e.getBoundingClientRect().top - 120; }"
LONG_MS = 60_000.0
LOADED = "document.querySelector('#job-detail img.picture').naturalWidth"


def gripped(address: str, sample: str, **wishes: Any) -> str:
    """Return a grip that has ended; over the network, since the browser uses this thread's event
    loop."""
    with Supervisor(address) as supervisor:
        job = supervisor.rig("demo").start("grip", sample=sample, queue=True, **wishes)
        job.wait(60.0)
        return job.id


def a_day_earlier(store: Database, job: str) -> None:
    with store.writing() as connection:
        connection.exec_driver_sql(
            "UPDATE jobs SET created_at = strftime('%Y-%m-%dT%H:%M:%fZ', created_at, '-1 day') "
            "WHERE id = ?",
            (job,),
        )


A_DAY_AHEAD = """const Real = Date; const shift = 86400e3;
window.Date = class extends Real {
  constructor(...values) { super(...(values.length ? values : [Real.now() + shift])); }
  static now() { return Real.now() + shift; }
};"""


def test_today_means_the_day_of_the_rig_even_if_the_clock_of_the_browser_is_wrong(
    browser: Browser, desk: Harness
) -> None:
    context = browser.new_context(viewport=ViewportSize(**DESK))
    context.add_init_script(A_DAY_AHEAD)
    with served(desk.app) as address:
        before, today = (gripped(address, sample) for sample in ("B7", "B8"))
        a_day_earlier(desk.store, before)
        seen = visit(context, address)
        seen.page.click("#tab-jobs")
        for when, wanted, other in (("today", today, before), ("yesterday", before, today)):
            seen.page.select_option("#job-when", when)
            seen.page.wait_for_selector(f"#open-{other}", state="detached")
            seen.page.wait_for_selector(f"#open-{wanted}")
        offset = f"{datetime.now().astimezone():%z}"
        assert f"UTC{offset[:3]}:{offset[3:]}" in seen.text("#job-days")
        context.close()


def test_a_job_of_yesterday_is_found_by_its_sample(
    browser: Browser, desk: Harness, pictures: Path
) -> None:
    context = browser.new_context(viewport=ViewportSize(**DESK), color_scheme="light")
    with served(desk.app) as address:
        names = ("Sphere 7", "Sphere 8", "Sphere 7")
        wanted, other, today = (gripped(address, sample) for sample in names)
        for job in (wanted, other):
            a_day_earlier(desk.store, job)
        seen = visit(context, address)
        seen.page.click("#tab-jobs")
        seen.page.wait_for_selector(f"#open-{today}")
        seen.page.fill("#job-text", "sphere 7")
        seen.page.select_option("#job-when", "yesterday")
        seen.until_true(
            lambda: seen.page.locator("#job-list tbody tr").count() == 1, "not narrowed"
        )
        keep_picture(seen, pictures, "find-list")
        seen.page.click(f"#open-{wanted}")
        seen.until("#job-detail", "Sphere 7")
        seen.until("#job-detail", "mN")
        seen.page.wait_for_selector("#job-detail img.picture")
        seen.until_true(lambda: bool(seen.page.evaluate(LOADED)), "the picture never came")
        seen.page.locator("#job-title").evaluate(TO_THE_TOP)
        keep_picture(seen, pictures, "find-job")
        seen.until("#job-detail .assumed", "model.free_response")
        seen.page.fill("#job-text", "nothing like it")
        seen.until("#job-list", "No such job.")
        seen.until("#job-detail", wanted)
        seen.page.select_option("#job-when", "")
        seen.page.fill("#job-text", "")
        seen.page.select_option("#job-kind", "move")
        seen.until("#job-list", "No such job.")
        assert seen.errors == []
    context.close()


def test_a_sample_is_entered_in_the_form_that_starts_a_job(browser: Browser, desk: Harness) -> None:
    context = browser.new_context()
    with served(desk.app) as address:
        seen = visit(context, address)
        seen.until_true(lambda: seen.page.input_value("#field-force_mN") != "", "no defaults came")
        seen.page.fill("#field-sample", " B9 ")
        seen.page.click("#start")
        seen.until_true(lambda: bool(desk.store.newest(1)), "no job was started")
    (job,) = desk.store.newest(2)
    assert job.request["sample"] == "B9"
    context.close()


def test_typed_text_is_kept_while_the_job_changes(browser: Browser, desk: Harness) -> None:
    context = browser.new_context()
    with served(desk.app) as address:
        job = gripped(address, "B12")
        seen = visit(context, address)
        seen.page.click("#tab-jobs")
        seen.page.click(f"#open-{job}")
        seen.page.wait_for_selector("#job-detail img.picture")
        seen.page.click("#job-said summary")
        seen.page.fill("#said-sample", "B12, the second")
        seen.page.check("#said-pinned")
        seen.page.focus("#said-notes")
        httpx.patch(f"{address}/api/v1/jobs/{job}", json={"batch": "W3"}).raise_for_status()
        other = gripped(address, "B13")
        seen.until("#job-detail dl", "W3")
        assert seen.page.input_value("#said-batch") == "W3"
        assert seen.page.input_value("#said-sample") == "B12, the second"
        assert seen.page.is_checked("#said-pinned")
        assert seen.page.evaluate("document.activeElement.id") == "said-notes"
        seen.page.click(f"#open-{other}")
        seen.until("#job-detail", other)
        assert seen.page.input_value("#said-sample") == "B13"
        assert not seen.page.is_checked("#said-pinned")
    context.close()


def test_a_job_can_be_described_after_its_end(browser: Browser, desk: Harness) -> None:
    context = browser.new_context()
    with served(desk.app) as address:
        job = gripped(address, "B10")
        seen = visit(context, address)
        seen.page.click("#tab-jobs")
        seen.page.click(f"#open-{job}")
        seen.page.click("#job-said summary")
        assert seen.page.input_value("#said-sample") == "B10"
        seen.page.fill("#said-sample", "B11")
        seen.page.fill("#said-notes", "chip <b>at the rim</b>")
        seen.page.fill("#said-labels", "glue")
        seen.page.click("#said-form button[type=submit]")
        seen.until("#said-fault", "is not a label")
        seen.page.fill("#said-labels", "glue=none")
        seen.page.check("#said-pinned")
        seen.page.click("#said-form button[type=submit]")
        seen.until("#job-detail dl", "chip <b>at the rim</b>")
        seen.until("#job-list", "B11 · glue=none")
        row = desk.store.get(job)
        assert row is not None
        assert (row.sample, row.labels, row.pinned) == ("B11", {"glue": "none"}, True)
        assert seen.errors == []
    context.close()


def test_a_job_that_started_and_ended_between_two_refreshes_is_listed(
    browser: Browser, desk: Harness
) -> None:
    context = browser.new_context()
    with served(desk.app) as address:
        before = gripped(address, "B14")
        seen = visit(context, address)
        seen.page.click("#tab-jobs")
        seen.page.wait_for_selector(f"#open-{before}")
        context.set_offline(offline=True)
        seen.until_true(lambda: "connected" not in seen.text("#connection"), "it looks on")
        after = gripped(address, "B15")
        context.set_offline(offline=False)
        seen.until("#job-list", "B15")
        seen.page.click(f"#open-{after}")
        seen.until("#job-detail", after)
    context.close()


FILLED = """async (requests) => {
  const { Fields } = await import("./page/js/form/fields.js");
  const { kinds } = await (await fetch("api/v1/kinds")).json();
  return requests.map((request) => {
    const fields = new Fields();
    const { form } = kinds.find((each) => each.name === request.kind);
    fields.show(form.filter((each) => each.arms.includes(1)), {}, { recipes: ["soft"] });
    fields.fill(request);
    return [{ kind: request.kind, ...fields.read() }, fields.lacking(request)];
  });
}"""
"""Fill forms with requests; return what each form would send, and which members of the request
it lacks."""
REQUESTS: list[dict[str, Any]] = [
    {
        "kind": "grip",
        "force_mN": 12.5,
        "hold_s": 1.5,
        "force_tolerance_mN": 0.8,
        "profile": "gentle",
    },
    {"kind": "grip", "recipe": "soft", "until_released": True, "on_stop": "release"},
    {"kind": "move", "by_um": -2.5},
    {
        "kind": "track",
        "shape": "waypoints",
        "points": [{"t_s": 0.0, "force_mN": 5.0}, {"t_s": 2.0, "force_mN": 10.25}],
    },
    {"kind": "track", "shape": "step", "levels_mN": [5.0, 10.5], "learn": False},
]


def test_the_button_run_again_fills_the_form_with_the_request_of_the_job(
    browser: Browser, desk: Harness
) -> None:
    context = browser.new_context(viewport=ViewportSize(**DESK))
    with served(desk.app) as address:
        wishes = {
            "force_mN": 12.5,
            "hold_s": 1.5,
            "force_tolerance_mN": 0.8,
            "labels": {"lot": "7"},
        }
        job = gripped(address, "B7", notes="dusty", **wishes)
        seen = visit(context, address)
        filled = seen.page.evaluate(FILLED, REQUESTS)
        for request, (sent, lacking) in zip(REQUESTS, filled, strict=True):
            stated = {name: value for name, value in request.items() if value is not False}
            assert {name: sent.get(name) for name in stated} == stated
            assert set(lacking) <= {"kind"}
        ((_, lacking),) = seen.page.evaluate(
            FILLED, [{"kind": "grip", "zero_confirmed": True, "recipe": "gone"}]
        )
        assert {"zero_confirmed", "recipe"} <= set(lacking)
        seen.page.click("#tab-jobs")
        seen.page.click(f"#open-{job}", timeout=LONG_MS)
        seen.page.click("#job-again", timeout=LONG_MS)
        seen.until("#start-filled", f"Filled in from the request of job {job}, without: labels.")
        assert seen.page.input_value("#field-notes") == ""
        with seen.page.expect_request(
            lambda request: request.method == "POST" and request.url.endswith("/jobs"),
            timeout=LONG_MS,
        ) as requested:
            seen.page.click("#start")
        body: dict[str, Any] = requested.value.post_data_json or {}
        del wishes["labels"]
        for name, value in {"kind": "grip", "sample": "B7", **wishes}.items():
            assert body[name] == value
        assert "notes" not in body
        assert seen.errors == []
    context.close()
