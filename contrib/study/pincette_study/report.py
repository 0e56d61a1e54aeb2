"""Report: sections of text, figures and comparisons, as one HTML file and as JSON."""

import base64
import html
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

STYLE = """
body { font: 16px/1.5 "Helvetica Neue", Arial, sans-serif; color: #22282f; max-width: 62rem;
  margin: 2rem auto; padding: 0 1.5rem; }
h1 { font-size: 1.7rem; } h2 { font-size: 1.25rem; margin-top: 2.6rem; }
img { max-width: 100%; } figure { margin: 1rem 0; }
figcaption { color: #66707a; font-size: .9rem; }
table { border-collapse: collapse; margin: 1rem 0; font-size: .92rem; }
th, td { text-align: left; padding: .25rem .9rem .25rem 0; border-bottom: 1px solid #e3e7eb;
  vertical-align: top; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
.no { color: #b3402a; } .yes { color: #3f8f5f; }
nav a { margin-right: 1rem; }
"""


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of a value with that of the paper."""

    quantity: str
    unit: str
    paper: float | None
    """Value of the paper; None if the paper does not give one."""
    ours: float
    note: str = ""

    @property
    def deviation_percent(self) -> float | None:
        """Return our value minus the paper's, in per cent of the paper's."""
        if self.paper is None or self.paper == 0.0:
            return None
        return 100.0 * (self.ours - self.paper) / abs(self.paper)


@dataclass(frozen=True, slots=True)
class Trend:
    """A statement of the paper about a trend, and whether it was confirmed."""

    claim: str
    holds: bool
    found: str
    """Result; if the trend was not confirmed, with the reason."""


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure of the report."""

    name: str
    caption: str
    png: bytes


@dataclass(frozen=True, slots=True)
class Section:
    """One experiment."""

    key: str
    title: str
    text: tuple[str, ...]
    """Paragraphs of the section."""
    pictures: tuple[Picture, ...] = ()
    comparisons: tuple[Comparison, ...] = ()
    trends: tuple[Trend, ...] = ()
    data: dict[str, Any] | None = None
    """Data for ``paper.json`` only."""


def write_report(folder: Path, sections: Sequence[Section], summary: dict[str, Any]) -> Path:
    """Write ``index.html``, ``paper.json`` and the figures; returns the page."""
    folder.mkdir(parents=True, exist_ok=True)
    for section in sections:
        for picture in section.pictures:
            (folder / f"{picture.name}.png").write_bytes(picture.png)
    page = folder / "index.html"
    page.write_text(_page(sections), encoding="utf-8")
    tree = {"summary": summary, "sections": {section.key: _tree(section) for section in sections}}
    text = json.dumps(tree, indent=2, ensure_ascii=False, allow_nan=False)
    (folder / "paper.json").write_text(text + "\n", encoding="utf-8")
    return page


def _tree(section: Section) -> dict[str, Any]:
    return {
        "title": section.title,
        "text": list(section.text),
        "comparisons": [
            {**asdict(item), "deviation_percent": item.deviation_percent}
            for item in section.comparisons
        ],
        "trends": [asdict(trend) for trend in section.trends],
        "data": section.data or {},
    }


def _page(sections: Sequence[Section]) -> str:
    links = "".join(f'<a href="#{item.key}">{html.escape(item.title)}</a> ' for item in sections)
    body = "\n".join(_section(item) for item in sections)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        "<title>The paper, repeated</title>"
        f"<style>{STYLE}</style></head><body><h1>The paper, repeated</h1>"
        "<p>Q. Xu, <em>Precision Position/Force Interaction Control of a Piezoelectric Multimorph "
        "Microgripper for Microassembly</em>, IEEE T-ASE 10(3), 2013: its experiments on a "
        "simulated rig, its numbers beside ours. Forces are compressive and positive; RMSE in per "
        "cent is of the peak-to-peak magnitude.</p>"
        f"<nav>{links}</nav>\n{body}</body></html>\n"
    )


def _section(section: Section) -> str:
    parts = [f'<section id="{section.key}"><h2>{html.escape(section.title)}</h2>']
    parts += [f"<p>{html.escape(paragraph)}</p>" for paragraph in section.text]
    for picture in section.pictures:
        image = base64.b64encode(picture.png).decode()
        parts.append(
            f'<figure><img alt="{html.escape(picture.caption)}" '
            f'src="data:image/png;base64,{image}">'
            f"<figcaption>{html.escape(picture.caption)}</figcaption></figure>"
        )
    parts += [_trends(section.trends), _comparisons(section.comparisons), "</section>"]
    return "\n".join(parts)


def _comparisons(items: Sequence[Comparison]) -> str:
    if not items:
        return ""
    rows = [
        '<tr><th>quantity</th><th class="number">paper</th><th class="number">here</th>'
        '<th class="number">deviation</th><th></th></tr>'
    ]
    for item in items:
        paper = "" if item.paper is None else f"{_number(item.paper)} {item.unit}"
        deviation = item.deviation_percent
        off = "" if deviation is None else f"{deviation:+.0f} %"
        cells = (paper, f"{_number(item.ours)} {item.unit}", off)
        numbers = "".join(f'<td class="number">{html.escape(cell)}</td>' for cell in cells)
        name, note = html.escape(item.quantity), html.escape(item.note)
        rows.append(f"<tr><td>{name}</td>{numbers}<td>{note}</td></tr>")
    return f"<table>{''.join(rows)}</table>"


def _trends(items: Sequence[Trend]) -> str:
    if not items:
        return ""
    rows = ["<tr><th>what the paper reports</th><th>here</th><th></th></tr>"]
    for item in items:
        kind, word = ("yes", "comes out") if item.holds else ("no", "does not")
        claim, found = html.escape(item.claim), html.escape(item.found)
        rows.append(f'<tr><td>{claim}</td><td class="{kind}">{word}</td><td>{found}</td></tr>')
    return f"<table>{''.join(rows)}</table>"


def _number(value: float) -> str:
    return f"{value:.4g}"
