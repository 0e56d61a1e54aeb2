"""No program compares or searches a text that is meant for people.

Such texts are ``detail``, ``fault``, ``cause`` and ``reason``, and the message of an error.
Members of an enumeration are compared: ``cause == Cause.ABORT``, ``status.fault.code is ...``.
"""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
FILES = sorted(path for part in ("shared", "services") for path in (ROOT / part).rglob("*.py"))
SCRIPTS = sorted((ROOT / "services").rglob("*.js"))
FACTS = frozenset({"detail", "fault", "cause", "reason"})
SEARCHES = frozenset(
    name
    for name in dir(str)
    if name.startswith(("starts", "ends", "find", "rfind", "index", "rindex", "remove", "split"))
    or name in {"count", "partition", "rpartition", "rsplit", "replace", "casefold", "lower"}
)
MATCHES = frozenset({"match", "search", "fullmatch", "findall", "finditer", "split", "sub"})
SCRIPT = re.compile(
    r"""\b(?:detail|fault|cause|reason|message)\b\)?\??\.
        (?:startsWith|endsWith|includes|indexOf|lastIndexOf|match|matchAll|search|split|replace)\b
      | \.test\([^)]*\b(?:detail|fault|cause|reason|message)\b
      | \b(?:detail|fault|cause|reason|message)\s*[=!]==\s*["'`][^"'`]""",
    re.VERBOSE,
)


class TextReader(ast.NodeVisitor):
    """Collects the lines at which a text for people is compared or searched."""

    def __init__(self) -> None:
        self.errors: list[str] = []
        self.lines: list[int] = []

    def visit_ExceptHandler(self, node: ast.ExceptHandler) -> None:
        self.errors.append(node.name or "")
        self.generic_visit(node)
        self.errors.pop()

    def visit_Compare(self, node: ast.Compare) -> None:
        operands = [node.left, *node.comparators]
        for operator, left, right in zip(node.ops, operands, operands[1:], strict=False):
            contained = isinstance(operator, ast.In | ast.NotIn)
            if (
                (contained and self.is_text(right))
                or (self.is_text(left) and has_text(right))
                or (self.is_text(right) and has_text(left))
            ):
                self.lines.append(node.lineno)
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        function = node.func
        if isinstance(function, ast.Attribute):
            searched = (
                function.attr in SEARCHES and bool(node.args) and self.is_text(function.value)
            )
            matched = function.attr in MATCHES and any(map(self.is_text, node.args))
            if searched or matched:
                self.lines.append(node.lineno)
        self.generic_visit(node)

    def visit_Match(self, node: ast.Match) -> None:
        patterns = [part for case in node.cases for part in ast.walk(case.pattern)]
        if self.is_text(node.subject) and any(
            isinstance(part, ast.MatchValue) and has_text(part.value) for part in patterns
        ):
            self.lines.append(node.lineno)
        self.generic_visit(node)

    def is_text(self, node: ast.expr) -> bool:
        """Return whether an expression is a text for people: the text of a field, or of a caught
        error."""
        if isinstance(node, ast.Attribute):
            return node.attr in FACTS or (node.attr == "args" and self.is_error(node.value))
        if isinstance(node, ast.Name):
            return node.id in FACTS
        if isinstance(node, ast.Subscript):
            key = node.slice
            return (isinstance(key, ast.Constant) and key.value in FACTS) or self.is_text(
                node.value
            )
        if isinstance(node, ast.BoolOp):
            return any(map(self.is_text, node.values))
        if isinstance(node, ast.Call):
            function, inner = node.func, node.args[0] if node.args else None
            if isinstance(function, ast.Name) and function.id in {"str", "repr"} and inner:
                return self.is_error(inner) or self.is_text(inner)
            if isinstance(function, ast.Attribute):
                if function.attr == "get":
                    return isinstance(inner, ast.Constant) and inner.value in FACTS
                return function.attr in SEARCHES and self.is_text(function.value)
        return False

    def is_error(self, node: ast.expr) -> bool:
        """Return whether an expression is the error that is being handled."""
        return isinstance(node, ast.Name) and node.id in self.errors


def has_text(node: ast.expr) -> bool:
    """Return whether an expression is a string literal, or a collection that contains one."""
    if isinstance(node, ast.Tuple | ast.List | ast.Set):
        return any(map(has_text, node.elts))
    if isinstance(node, ast.JoinedStr):
        return True
    return isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value != ""


def texts_read(source: str) -> list[int]:
    """Return the lines of a Python file that compare or search a text for people."""
    reader = TextReader()
    reader.visit(ast.parse(source))
    return reader.lines


def texts_read_by_script(source: str) -> list[int]:
    """Return the lines of a script of the page that compare or search a text for people."""
    return [source.count("\n", 0, found.start()) + 1 for found in SCRIPT.finditer(source)]


def test_no_program_parses_text_meant_for_people() -> None:
    assert len(FILES) > 300
    found = {
        str(path.relative_to(ROOT)): lines
        for path in FILES
        if (lines := texts_read(path.read_text(encoding="utf-8")))
    }
    assert not found, f"use a code instead: {found}"


def test_the_page_parses_no_text_meant_for_people() -> None:
    assert len(SCRIPTS) > 10
    found = {
        str(path.relative_to(ROOT)): lines
        for path in SCRIPTS
        if (lines := texts_read_by_script(path.read_text(encoding="utf-8")))
    }
    assert not found, f"use a code instead: {found}"
