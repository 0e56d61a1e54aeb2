"""The page over HTTP: its files, and nothing else."""

import base64
import hashlib
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pincette.config import RigFile
from pincette.core.number_tables import MOST_BYTES
from pincette.records import parquet

from .harness import Harness


def test_the_page_names_the_rig_and_loads_nothing_from_elsewhere(harness: Harness) -> None:
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
def test_no_other_file_is_served(harness: Harness, name: str) -> None:
    assert harness.call("GET", f"/page/{name}").status_code == 404


def test_a_file_of_points_is_read_as_on_the_command_line(harness: Harness, tmp_path: Path) -> None:
    def read(content: bytes) -> Any:
        return harness.call("POST", "/page/points?columns=t_s,force_mN", content=content)

    wanted = [{"t_s": 0.0, "force_mN": 5.0}, {"t_s": 1.5, "force_mN": 7.25}]
    assert read(b"t_s;force_mN\n0;5\n1,5;7,25\n").json() == wanted
    fields = [parquet.Field(name, "", "", "float") for name in ("x_um", "force_mN", "t_s")]
    columns = {one.name: [row.get(one.name, 1.0) for row in wanted] for one in fields}
    parquet.write(tmp_path / "path.parquet", fields, columns, {})
    assert read((tmp_path / "path.parquet").read_bytes()).json() == wanted
    for content, why in (
        (b"t_s;force_mN\n0;5\n1,5;x\n", "the file, line 3: force_mN = 'x'"),
        (b"PAR1", "the file cannot be read"),
        (b"\xff\xfe0", "UTF-16"),
    ):
        answer = read(content)
        assert answer.status_code == 422
        assert why in answer.json()["detail"]
    assert read(bytes(MOST_BYTES + 1)).status_code == 413


def test_a_rigs_name_is_escaped(rig_file: RigFile, open_harness: Callable[..., Harness]) -> None:
    named = rig_file.rig.model_copy(update={"name": 'a"><script>'})
    harness = open_harness(rig_file.model_copy(update={"rig": named}))
    assert "<script>" not in harness.call("GET", "/").text
