"""The how-to's control law on a whole rig: chosen on the page, and on the command line."""

import json
import subprocess
import sys
from collections.abc import Generator

import pytest
from playwright.sync_api import Browser

from tests.support.browser import looked_at
from tests.support.example_packages import installed, python_path
from tests.support.grips import SHORT, make_ready
from tests.support.rigs import paced_rig
from tests.support.running import RunningRig, running_rig

NAME = "example_impedance"
LONG_S = 90.0


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    """A rig all of whose programs find the law."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", python_path(installed("law", tmp_path_factory)))
        with running_rig(paced_rig(SHORT), tmp_path_factory.mktemp("rig")) as running:
            yield running


def test_it_grips_from_the_command_line(rig: RunningRig) -> None:
    make_ready(rig, LONG_S)
    url = f"http://{rig.rig.supervisor.host}:{rig.rig.supervisor.port}"
    words = ["job", "grip", "--url", url, "--scheme", NAME, "--gains", "K_I=0.25", "--json"]
    done = subprocess.run(
        [sys.executable, "-m", "pincette", *words],
        capture_output=True,
        text=True,
        timeout=LONG_S,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    (job,) = rig.get("/jobs", limit=1)["jobs"]
    assert json.dumps(job["id"]) in done.stdout
    law = rig.job(job["id"])["values"]["law"]
    assert (law["scheme"], law["gains"]["K_I"]) == (NAME, 0.25)


def test_the_page_offers_it_with_its_gains(rig: RunningRig, browser: Browser) -> None:
    make_ready(rig, LONG_S)
    with looked_at(browser, rig.rig) as seen:
        seen.until("#fact-start", "can start")
        seen.page.select_option("#kind", "grip")
        seen.page.click("#more-fields summary")
        gain = seen.page.locator(f"#field-{NAME}-K_I")
        assert not gain.is_visible()
        seen.page.select_option("#field-scheme", NAME)
        seen.until_true(gain.is_visible, "its gains never came")
        gain.fill("0.2")
        before = rig.get("/jobs", limit=1)["jobs"]
        seen.page.click("#start")
        seen.until_true(lambda: rig.get("/jobs", limit=1)["jobs"] != before, "no job came")
        (job,) = rig.get("/jobs", limit=1)["jobs"]
        ended = rig.ended(job["id"], LONG_S)
        assert ended["state"] == "succeeded", ended["cause"]
        assert ended["values"]["law"]["gains"]["K_I"] == 0.2
        assert ended["request"]["gains"] == {"K_I": 0.2}
        assert seen.errors == []
