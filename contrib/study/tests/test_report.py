"""The report contains all results and escapes its texts."""

import json
from html.parser import HTMLParser
from math import nan
from pathlib import Path
from typing import Any

import pytest

from pincette_study.report import Comparison, Picture, Section, Trend, write_report

ODD = 'K_e < 2 & "stiff" <script>alert(1)</script>'
PNG = b"\x89PNG\r\n\x1a\nno picture, but bytes"


class Page(HTMLParser):
    """Tags in order, tags that were not closed, and the text."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.open: list[str] = []
        self.text = ""
        self.values: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.values += [value for _, value in attrs if value is not None]
        if tag not in ("img", "meta"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def section(**changes: Any) -> Section:
    values: dict[str, Any] = {
        "key": "fig5",
        "title": "Fig. 5",
        "text": ("one paragraph", "another"),
        "pictures": (Picture("fig5", "the mode", PNG),),
        "comparisons": (
            Comparison("slope", "mN/µm", 2.0, 2.5, "by hand"),
            Comparison("offset", "mN", -4.0, -3.0),
            Comparison("radius", "", None, 0.86),
            Comparison("nothing", "mN", 0.0, 0.1),
        ),
        "trends": (Trend("falls", True, "3, 2, 1"), Trend("rises", False, "no reason")),
        "data": {"x_um": [1.0, 2.0]},
    }
    return Section(**{**values, **changes})


def written(folder: Path, *sections: Section) -> tuple[Page, dict[str, Any]]:
    path = write_report(folder / "deep" / "report", sections, {"random_rigs": 3})
    assert path == folder / "deep" / "report" / "index.html"
    page = Page()
    page.feed(path.read_text(encoding="utf-8"))
    assert page.open == []
    return page, json.loads((path.parent / "paper.json").read_text(encoding="utf-8"))


def test_results_are_compared_with_those_of_the_paper(tmp_path: Path) -> None:
    page, tree = written(tmp_path, section())
    assert tree["summary"] == {"random_rigs": 3}
    found = tree["sections"]["fig5"]
    assert [item["deviation_percent"] for item in found["comparisons"]] == [25.0, 25.0, None, None]
    assert found["comparisons"][0]["paper"] == 2.0
    assert found["text"] == ["one paragraph", "another"]
    assert [trend["holds"] for trend in found["trends"]] == [True, False]
    assert found["data"] == {"x_um": [1.0, 2.0]}
    for text in ("2 mN/µm", "2.5 mN/µm", "+25 %", "by hand", "comes out", "does not"):
        assert text in page.text
    assert (tmp_path / "deep" / "report" / "fig5.png").read_bytes() == PNG
    assert page.tags.count("img") == 1


@pytest.mark.parametrize(
    ("paper", "ours", "deviation"),
    [(2.0, 1.0, -50.0), (-4.0, -5.0, -25.0), (-4.0, 4.0, 200.0), (0.0, 1.0, None)],
)
def test_a_deviation_is_signed_and_relative_to_the_magnitude_in_the_paper(
    paper: float, ours: float, deviation: float | None
) -> None:
    assert Comparison("force", "mN", paper, ours).deviation_percent == deviation


def test_written_text_is_escaped(tmp_path: Path) -> None:
    odd = section(
        title=ODD,
        text=(ODD,),
        pictures=(Picture("fig5", ODD, PNG),),
        comparisons=(Comparison(ODD, "<µm>", 1.0, 1.0, ODD),),
        trends=(Trend(ODD, True, ODD),),
        data={ODD: ODD},
    )
    page, tree = written(tmp_path, odd)
    assert "script" not in page.tags
    # Title twice, paragraph, caption, quantity, note, claim, finding.
    assert page.text.count(ODD) == 8
    assert ODD in page.values
    assert "1 <µm>" in page.text
    assert tree["sections"]["fig5"]["data"] == {ODD: ODD}


def test_non_finite_numbers_are_not_written(tmp_path: Path) -> None:
    for broken in (
        section(data={"x_um": [nan]}),
        section(comparisons=(Comparison("slope", "", 1.0, float("inf")),)),
    ):
        with pytest.raises(ValueError, match="not JSON compliant"):
            write_report(tmp_path, (broken,), {})
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_report(tmp_path, (section(),), {"rmse_mN": nan})
    assert not (tmp_path / "paper.json").exists()


def test_a_section_may_be_empty(tmp_path: Path) -> None:
    bare = section(pictures=(), comparisons=(), trends=(), data=None)
    page, tree = written(tmp_path, bare, section(key="fig6"))
    assert list(tree["sections"]) == ["fig5", "fig6"]
    assert tree["sections"]["fig5"]["data"] == {}
    assert page.tags.count("table") == 2
    assert {"fig5", "#fig5", "fig6", "#fig6"} <= set(page.values)
