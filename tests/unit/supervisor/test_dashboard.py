"""The dashboard of deploy/grafana uses metrics and labels that exist."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from pincette_supervisor.metrics import FAMILIES
from tests.support.checkout import ROOT

FILE = ROOT / "deploy/grafana/pincette.json"
TREE: dict[str, Any] = json.loads(FILE.read_text(encoding="utf-8"))
BY_NAME = {family.name: family for family in FAMILIES}
NAMED = re.compile(r"(pincette_\w+?)(_bucket|_sum|_count)?\{([^}]*)\}")


def expressions() -> list[str]:
    requests = [one["expr"] for panel in TREE["panels"] for one in panel["targets"]]
    (rigs,) = (one for one in TREE["templating"]["list"] if one["name"] == "rig")
    return [
        *requests,
        re.sub(r"label_values\((\w+), (\w+)\)", r'\1{\2=""}', rigs["query"]["query"]),
    ]


def test_every_metric_and_label_is_served() -> None:
    for expression in expressions():
        found = list(NAMED.finditer(expression))
        assert len(found) == expression.count("pincette_"), expression
        for match in found:
            name, part, labels = match.groups()
            family = BY_NAME[name]
            assert bool(part) == (family.kind == "histogram"), expression
            known = {*family.labels, "le"} if part else set(family.labels)
            assert {one.split("=")[0].rstrip("!~") for one in labels.split(",")} <= known
            grouped = re.findall(r"by \(([^)]*)\)", expression)
            assert {one.strip() for by in grouped for one in by.split(",")} <= known, expression


def test_legends_of_the_dashboard_use_existing_labels() -> None:
    for panel in TREE["panels"]:
        for one in panel["targets"]:
            names = set(re.findall(r"{{(\w+)}}", one["legendFormat"]))
            assert all(name in one["expr"] or _label(one["expr"], name) for name in names), one


def _label(expression: str, name: str) -> bool:
    return all(name in BY_NAME[match[1]].labels for match in NAMED.finditer(expression))


def test_prometheus_accepts_every_expression_of_the_dashboard(tmp_path: Path) -> None:
    promtool = shutil.which("promtool")
    if promtool is None:
        pytest.skip("promtool is not installed (Debian: prometheus)")
    variables = {"$__rate_interval": "1m", "$rig": "demo"}
    rules: list[dict[str, str]] = []
    for number, expression in enumerate(expressions()):
        text = expression
        for name, value in variables.items():
            text = text.replace(name, value)
        rules.append({"record": f"panel:{number}", "expr": text})
    path = tmp_path / "rules.yml"
    path.write_text(json.dumps({"groups": [{"name": "panels", "rules": rules}]}), encoding="utf-8")
    done = subprocess.run(
        [promtool, "check", "rules", path], capture_output=True, text=True, timeout=30, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{len(rules)} rules found" in done.stdout
