"""Settings of the documentation site, which ``make site`` builds from this folder.

The tables in docs/README.md and docs/decisions/README.md define its contents. A page that neither
table links causes a warning, and every warning fails the build.
"""

import re
import shutil
from importlib.metadata import version as version_of
from itertools import groupby
from pathlib import Path
from typing import Any

project = "pincette"
version = release = version_of("pincette")
author = copyright = ""  # noqa: A001 (a name of Sphinx)

extensions = ["myst_parser"]
source_suffix = {".md": "markdown"}
root_doc = "README"
nitpicky = True
myst_heading_anchors = 3
highlight_language = "none"

html_theme = "furo"
html_title = f"pincette {version}"
html_static_path = ["site"]
html_css_files = ["site.css"]
html_show_sphinx = html_show_copyright = html_show_sourcelink = html_copy_source = False

SECTIONS = {
    "tutorials": "Tutorials",
    "how-to": "How to",
    "reference": "Reference",
    "explanations": "Explanations",
    "decisions": "Decisions",
}
CONTENTS = ("README", "decisions/README")
LINK = re.compile(r"\]\(([\w./-]+)\.md\)")


def _listed(section: str, pages: list[str]) -> str:
    return "\n```{toctree}\n:hidden:\n:caption: " + "\n".join((section, "", *pages)) + "\n```\n"


def add_contents(_app: Any, page: str, source: list[str]) -> None:
    """Add lists of the linked pages to a page of contents, one for each section of its table."""
    if page not in CONTENTS:
        return
    pages = list(dict.fromkeys(LINK.findall(source[0])))
    if page != root_doc:
        source[0] += "\n```{toctree}\n:hidden:\n\n" + "\n".join(pages) + "\n```\n"
        return
    order = list(SECTIONS)
    pages.sort(key=lambda name: order.index(name.partition("/")[0]))
    for folder, names in groupby(pages, key=lambda name: name.partition("/")[0]):
        source[0] += _listed(SECTIONS[folder], list(names))


def add_index(app: Any, failure: Exception | None) -> None:
    """Also provide the first page under the file name that a web server expects."""
    if failure is None and app.builder.format == "html":
        folder = Path(app.outdir)
        shutil.copyfile(folder / f"{root_doc}.html", folder / "index.html")


def setup(app: Any) -> dict[str, bool]:
    """Set up the extension; called by Sphinx."""
    app.connect("source-read", add_contents)
    app.connect("build-finished", add_index)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
