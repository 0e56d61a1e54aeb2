"""The file with the measurements; each bench keeps the entries of the others."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

REPORT = Path("bench.json")


def keep(summary: Mapping[str, float], details: Mapping[str, Any]) -> None:
    """Add figures to the summary of ``bench.json`` and details next to it."""
    report: dict[str, Any] = {}
    if REPORT.is_file():
        report = json.loads(REPORT.read_text(encoding="utf-8"))
    before = cast("dict[str, float]", report.get("summary", {}))
    report |= {"summary": {**before, **summary}, **details}
    REPORT.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
