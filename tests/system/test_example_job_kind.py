"""The how-to guide's kind of job, installed as an external package: over REST, CLI and page."""

import json
import re
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from tests.support.browser import looked_at
from tests.support.example_packages import installed, python_path
from tests.support.grips import SHORT, make_ready
from tests.support.rigs import paced_rig
from tests.support.running import RunningRig, running_rig

FILES = ("pyproject.toml", "pincette_example_tap/__init__.py", "pincette_example_tap/functions.py")
LONG_S = 90.0


@pytest.fixture(scope="module")
def example() -> Path:
    return Path(__file__).parents[2] / "docs/examples/job_kind"


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    """A rig whose programs find the package."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", python_path(installed("job_kind", tmp_path_factory)))
        with running_rig(paced_rig(SHORT), tmp_path_factory.mktemp("rig")) as running:
            make_ready(running, LONG_S)
            yield running


def pincette(rig: RunningRig, *words: str) -> subprocess.CompletedProcess[str]:
    url = f"http://{rig.rig.supervisor.host}:{rig.rig.supervisor.port}"
    return subprocess.run(
        [sys.executable, "-m", "pincette", *words, "--url", url],
        capture_output=True,
        text=True,
        timeout=LONG_S,
        check=False,
    )


def newest(rig: RunningRig) -> str:
    """Return the id of the newest job; empty if there is none."""
    return next((job["id"] for job in rig.get("/jobs", limit=1)["jobs"]), "")


@pytest.mark.parametrize("name", FILES)
def test_the_page_shows_the_complete_file(example: Path, name: str) -> None:
    page = (example.parents[1] / "how-to/add-a-job-kind.md").read_text(encoding="utf-8")
    shown = re.findall(r"^```(?:toml|python)\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert (example / name).read_text(encoding="utf-8") in shown


def test_the_kind_is_listed_planned_and_run_over_rest(rig: RunningRig) -> None:
    kinds = {kind["name"]: kind for kind in rig.get("/kinds")["kinds"]}
    assert [field["name"] for field in kinds["tap"]["form"]] == ["force_mN"]
    assert kinds["tap"]["request"]["properties"]["force_mN"]["unit"] == "mN"
    plan = rig.post("/jobs?dry_run=true", {"kind": "tap", "force_mN": 8.0}).json()
    assert (plan["kind"], plan["feasible"]) == ("tap", True)
    assert plan["prediction"]["outcome"] == "gripped"
    refused = rig.post("/jobs", {"kind": "tap", "force_mN": 30.0})
    assert refused.status_code == 422
    assert refused.json()["errors"][0]["pointer"] == "/force_mN"
    name = rig.post("/jobs", {"kind": "tap", "autostart": True}).raise_for_status().json()["id"]
    job = rig.ended(name, LONG_S)
    assert (job["kind"], job["state"], job["cause"]) == ("tap", "succeeded", "")
    assert job["result"]["contact_x_um"] == pytest.approx(6.2, abs=1.0)
    files = {file["name"] for file in rig.get(f"/jobs/{name}/artifacts")["artifacts"]}
    assert {"tap.png", "report.html", "samples.parquet"} <= files
    picture = rig.client.get(f"/jobs/{name}/artifacts/tap.png")
    assert picture.content.startswith(b"\x89PNG")


def test_the_kind_is_a_command(rig: RunningRig) -> None:
    make_ready(rig, LONG_S)
    listed = pincette(rig, "job", "tap", "--force-mN", "9", "--json")
    assert listed.returncode == 0, listed.stdout + listed.stderr
    job = json.loads(listed.stdout)
    assert (job["kind"], job["values"]["force_mN"]) == ("tap", 9.0)
    assert job["result"]["contact_stiffness_mN_per_um"] > 0.0


def test_the_kind_is_in_the_form_of_the_page_and_its_result_is_shown(
    rig: RunningRig, browser: Browser
) -> None:
    make_ready(rig, LONG_S)
    with looked_at(browser, rig.rig) as seen:
        seen.until("#fact-start", "can start")
        seen.page.select_option("#kind", "tap")
        assert "Touch with" in seen.text("#start-form")
        seen.page.fill("#field-force_mN", "10")
        known = newest(rig)
        seen.page.click("#start")
        seen.until_true(lambda: newest(rig) != known, "no job came")
        name = newest(rig)
        assert rig.job(name)["values"]["force_mN"] == 10.0
        assert rig.ended(name, LONG_S)["state"] == "succeeded"
        seen.until("#current-title", "Last job: tap", LONG_S)
        seen.until("#current", name)
        seen.until("#current", "part at")
        seen.page.click("#current-open")
        seen.until("#job-detail", name)
        seen.until("#job-detail", "stiffness")
        seen.until_true(
            lambda: seen.page.locator("#job-detail img").count() == 1, "no picture came"
        )
