"""Rules for every file of the tree: its size, forbidden names, and valid links."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

FOREIGN = re.compile(
    r"""https?://[a-z0-9.:-]+/(?:simple|packages)(?:/|\b)   # a package index
      | \bregistry\.[a-z0-9-]+\.(?:org|com)\b
      | \b(?:test\.)?pypi\.org\b | \bfiles\.pythonhosted\.org\b
      | /(?:work|root)/                                     # paths of one machine
      | \bfile:///(?!\.)""",
    re.VERBOSE,
)
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
CODE = re.compile(r"`[^`\n]*`")


def text_of(path: Path) -> str:
    """Return the text of a file; empty if it is binary."""
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return ""


def test_no_file_contains_a_package_index_or_a_name_of_this_machine(
    files: list[Path], root: Path
) -> None:
    found = [
        f"{path.relative_to(root)}:{number}: {line.strip()[:100]}"
        for path in files
        for number, line in enumerate(text_of(path).splitlines(), start=1)
        if FOREIGN.search(line)
    ]
    assert found == []


def anchors(path: Path) -> set[str]:
    """Return the anchors of the headings of a Markdown file, which are made from their words."""
    headings = re.findall(r"^#+ +(.*)$", text_of(path), re.MULTILINE)
    words = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings)
    return {heading.strip().replace(" ", "-") for heading in words}


def dead_links(path: Path) -> Iterator[str]:
    for target in LINK.findall(CODE.sub("", text_of(path))):
        if "://" in target or target.startswith("mailto:"):
            continue
        name, _, anchor = target.partition("#")
        goal = path.parent / name if name else path
        if not goal.exists() or (anchor and goal.suffix == ".md" and anchor not in anchors(goal)):
            yield target


def test_no_document_has_a_dead_link(files: list[Path], root: Path) -> None:
    documents = [path for path in files if path.suffix == ".md"]
    assert root / "README.md" in documents
    dead = {str(path.relative_to(root)): list(dead_links(path)) for path in documents}
    assert {name: targets for name, targets in dead.items() if targets} == {}


def undocumented(tree: ast.AST) -> Iterator[str]:
    """Return the public functions and classes without a docstring."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            if ast.get_docstring(node) is None:
                yield node.name
            if isinstance(node, ast.ClassDef):
                yield from (f"{node.name}.{name}" for name in undocumented(node))


def test_mathematics_is_documented(root: Path) -> None:
    modules = sorted((root / "shared/pincette/control").rglob("*.py"))
    assert modules
    assert {
        module.name: bare
        for module in modules
        if (bare := list(undocumented(ast.parse(text_of(module)))))
    } == {}
