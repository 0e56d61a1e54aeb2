"""No program of the product executes text as code."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
FORBIDDEN = {"exec", "eval"}
FILES = sorted(path for part in ("shared", "services") for path in (ROOT / part).rglob("*.py"))


def made_of_text(source: str) -> list[int]:
    """Return the lines that name a builtin which executes text."""
    return [
        node.lineno
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Name) and node.id in FORBIDDEN
    ]


def test_no_file_of_the_product_executes_text_as_code() -> None:
    assert len(FILES) > 300
    found = {
        str(path.relative_to(ROOT)): lines
        for path in FILES
        if (lines := made_of_text(path.read_text(encoding="utf-8")))
    }
    assert not found, f"exec or eval: {found}"
