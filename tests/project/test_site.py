"""The documentation site is built strictly, every page is reachable, and all assets are local."""

import os
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag

import pytest

BUILD = (sys.executable, "-m", "sphinx", "-b", "html", "-W", "--keep-going", "--quiet")
BUILD_S = 300.0
ASSETS = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src"}
REMOTE = re.compile(r"(?:[a-z]+:)?//", re.IGNORECASE)
IN_STYLE = re.compile(r"(?:@import\s+|url\()\s*[\"']?((?:[a-z]+:)?//[^\"')\s]+)", re.IGNORECASE)


class Page(HTMLParser):
    """Resources that a page loads, targets of its links, and its anchors."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.links: list[str] = []
        self.places: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        if tag in ASSETS and ASSETS[tag] in given:
            self.loads.append(given[ASSETS[tag]])
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        self.places |= {given["id"]} if "id" in given else set()


def built(source: Path, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [*BUILD, str(source), str(folder / "site"), "-d", str(folder / "pages")]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=BUILD_S, check=False, env=os.environ
    )


@pytest.fixture(scope="module")
def site(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("built")
    done = built(root / "docs", folder)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / "site"


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    files = sorted(path for path in site.rglob("*.html") if "_downloads" not in path.parts)
    return {path: Page(path.read_text(encoding="utf-8")) for path in files}


def test_make_site_treats_warnings_as_errors(root: Path) -> None:
    makefile = (root / "Makefile").read_text(encoding="utf-8")
    assert " ".join(("sphinx-build", *BUILD[3:])) in makefile


def test_nothing_is_loaded_from_other_sites(site: Path, pages: dict[Path, Page]) -> None:
    loads = {(path.name, place) for path, page in pages.items() for place in page.loads}
    assert loads
    assert {item for item in loads if REMOTE.match(item[1])} == set()
    styles = list(site.rglob("*.css"))
    assert styles
    for path in styles:
        assert IN_STYLE.findall(path.read_text(encoding="utf-8")) == [], path.name


def followed(path: Path, page: Page) -> dict[Path, set[str]]:
    """Return the files to which a page links, with the anchors in them."""
    found: dict[Path, set[str]] = {}
    for link in page.links:
        target, place = urldefrag(link)
        if not REMOTE.match(target):
            goal = (path.parent / unquote(target)).resolve() if target else path
            found.setdefault(goal, set()).update({place} - {""})
    return found


def test_every_link_is_resolved(site: Path, pages: dict[Path, Page]) -> None:
    dead: list[str] = []
    for path, page in pages.items():
        for goal, places in followed(path, page).items():
            there = pages[goal].places if goal in pages else set[str]()
            if not goal.exists() or not places <= there:
                dead.append(f"{path.relative_to(site)}: {goal.name} {places - there}")
    assert dead == []


def test_every_page_is_reached_from_the_first(
    root: Path, site: Path, pages: dict[Path, Page]
) -> None:
    reached, waiting = set[Path](), [site / "index.html"]
    while waiting:
        path = waiting.pop()
        if path in pages and path not in reached:
            reached.add(path)
            waiting += followed(path, pages[path])
    written = {path.relative_to(root / "docs") for path in (root / "docs").rglob("*.md")}
    missing = {str(path) for path in written if site / path.with_suffix(".html") not in reached}
    assert missing == set(), "docs/README.md, or decisions/README.md, has no row for them"


@pytest.mark.parametrize(
    ("file", "text", "words"),
    [
        ("how-to/lost.md", "# Lost\n", "isn't included in any toctree"),
        ("tutorials/a.md", "# A\n\n[b](../how-to/b.md)\n", "not found: '../how-to/b.md'"),
        ("tutorials/a.md", "# A\n\n[b](../README.md#nowhere)\n", "nowhere"),
        ("tutorials/a.md", "# A\n\n![b](../images/b.png)\n", "image file not readable"),
    ],
)
def test_a_fault_ends_the_build(
    root: Path, tmp_path: Path, file: str, text: str, words: str
) -> None:
    source = tmp_path / "docs"
    (source / "tutorials").mkdir(parents=True)
    (source / "how-to").mkdir()
    shutil.copy(root / "docs/conf.py", source)
    shutil.copytree(root / "docs/site", source / "site")
    (source / "README.md").write_text("# First\n\n[a](tutorials/a.md)\n", encoding="utf-8")
    (source / "tutorials/a.md").write_text("# A\n", encoding="utf-8")
    (source / file).write_text(text, encoding="utf-8")
    done = built(source, tmp_path)
    assert done.returncode != 0
    assert words in done.stderr
