"""The page over HTTP: its files, and nothing else."""

import base64
import hashlib
import re
from collections.abc import Callable

import pytest

from pincette.config import RigFile

from .harness import Harness


def test_the_page_names_the_rig_and_lets_nothing_in(harness: Harness) -> None:
    page = harness.call("GET", "/")
    assert page.status_code == 200
    assert 'action="api/v1/rigs/demo/estop"' in page.text
    assert re.findall(r'(?:src|href|action)="(?:/|[a-z]+:)', page.text) == []
    assert "{{" not in page.text
    policy = page.headers["content-security-policy"]
    scripts = re.findall(r"<script[^>]*>([^<]+(?:<[^/][^<]*)*)</script>", page.text)
    (stop,) = [hashlib.sha256(text.encode()).digest() for text in scripts]
    allowed = f"script-src 'self' 'sha256-{base64.b64encode(stop).decode()}';"
    assert policy.startswith(f"default-src 'none'; {allowed}")
    assert "unsafe" not in policy
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
