"""The page over HTTP: its files, and nothing else."""

from collections.abc import Callable

import pytest

from pincette.config import RigFile

from .harness import Harness


def test_the_page_names_the_rig_and_lets_nothing_in(harness: Harness) -> None:
    page = harness.call("GET", "/")
    assert page.status_code == 200
    assert 'action="/api/v1/rigs/demo/estop"' in page.text
    assert "{{" not in page.text
    policy = page.headers["content-security-policy"]
    assert policy.startswith("default-src 'none'; script-src 'self';")
    assert "unsafe" not in policy
    assert "<script>" not in page.text
    assert " style=" not in page.text


@pytest.mark.parametrize("name", ["js/main.js", "js/form/form.js", "css/page.css", "icon.svg"])
def test_every_file_of_the_page_is_served(harness: Harness, name: str) -> None:
    answer = harness.call("GET", f"/page/{name}")
    assert answer.status_code == 200
    assert answer.headers["x-content-type-options"] == "nosniff"


@pytest.mark.parametrize("name", ["none.js", "index.html", "..%2Fconfig.py", "%2e%2e/config.py"])
def test_nothing_else_is_served(harness: Harness, name: str) -> None:
    assert harness.call("GET", f"/page/{name}").status_code == 404


def test_a_rigs_name_is_no_markup(rig_file: RigFile, open_harness: Callable[..., Harness]) -> None:
    named = rig_file.rig.model_copy(update={"name": 'a"><script>'})
    harness = open_harness(rig_file.model_copy(update={"rig": named}))
    assert "<script>" not in harness.call("GET", "/").text
