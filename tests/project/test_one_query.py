"""Every query and request on the bus goes through one function."""

import ast
import re
from pathlib import Path

QUERIES = {"declare_querier"}
ONE = "shared/pincette/bus/query.py"
EXAMPLE = "docs/examples/latest.py"
"""Shows the same call to readers who do not use pincette."""
MATCHING = "shared/pincette/bus/zenoh_bus.py"
"""Declares a querier to find out whether a queryable exists; sends no query with it."""
ARGUMENTS = {"target", "consolidation", "attachment", "timeout"}


def queries(path: Path) -> list[ast.Call]:
    """Return the calls of a file that query a Zenoh session; liveliness tokens are no queries."""
    text = path.read_text(encoding="utf-8")
    if re.search(r"^(import|from) zenoh", text, re.MULTILINE) is None:
        return []
    calls = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)]
    return [
        call
        for call in calls
        if isinstance(call.func, ast.Attribute)
        and (
            call.func.attr in QUERIES
            or (
                call.func.attr == "get"
                and any(word.arg == "timeout" for word in call.keywords)
                and "liveliness" not in ast.unparse(call.func.value)
                and "_arrived" not in ast.unparse(call.func.value)
            )
        )
    ]


def test_one_function_queries_the_bus_with_all_targets(root: Path) -> None:
    places = [
        path
        for part in ("shared", "services", "docs", "contrib")
        for path in root.glob(f"{part}/**/*.py")
    ]
    found = {str(path.relative_to(root)): made for path in places if (made := queries(path))}
    assert set(found) == {ONE, EXAMPLE, MATCHING}
    (querier,) = found.pop(MATCHING)
    assert [word.arg for word in querier.keywords] == []
    assert "querier.get(" not in (root / MATCHING).read_text(encoding="utf-8")
    for calls in found.values():
        (call,) = calls
        named = {word.arg: ast.unparse(word.value) for word in call.keywords}
        assert set(named) >= ARGUMENTS
        assert named["target"] == "zenoh.QueryTarget.ALL"
        assert named["consolidation"] == "zenoh.ConsolidationMode.NONE"
