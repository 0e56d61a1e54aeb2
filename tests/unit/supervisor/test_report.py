"""The report of a job is one page that needs nothing else."""

from html.parser import HTMLParser
from typing import Any

import pytest

from pincette.api.job_kinds import job_kinds
from pincette.api.live import LoopTiming
from pincette.api.results import MotionResult
from pincette.api.states import OUTCOMES
from pincette_supervisor.kinds.grip import GripResult
from pincette_supervisor.kinds.track import TrackResult
from pincette_supervisor.results.documents import report, verdict

WHOSE = {"job": "20260301-1", "rig": "demo", "model_version": "3", "created_at": "2026-03-01"}
COMPLETE: dict[str, bool | str] = {"complete": True, "detail": ""}
EMPTY = {"meta", "img"}


class Page(HTMLParser):
    """Elements that are closed in order, their attributes, and the text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.attributes: list[tuple[str, str, str]] = []
        self.text: list[str] = []
        self._open: list[str] = []
        self.feed(text)
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        if tag not in EMPTY:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if data.strip():
            self.text.append(data.strip())


def _example(model: type[GripResult | TrackResult | MotionResult | LoopTiming]) -> dict[str, Any]:
    extra: Any = model.model_config.get("json_schema_extra")
    return dict(extra["examples"][0])


def _page(result: dict[str, Any], **other: Any) -> Page:
    given: dict[str, Any] = {
        "kind": job_kinds()["grip"],
        "values": {"force_mN": 20.0, "law": {"K_P": 1.0}},
        "picture": b"\x89PNG",
        "whose": WHOSE,
        "state": COMPLETE,
    }
    return Page(report(result=result, **{**given, **other}))


@pytest.mark.parametrize("model", [GripResult, TrackResult, MotionResult])
def test_the_page_loads_no_other_files(model: type[GripResult]) -> None:
    page = _page(_example(model))
    links = [value for _, name, value in page.attributes if name in ("src", "href")]
    assert len(links) == 1
    assert links[0].startswith("data:image/png;base64,")


def test_the_report_starts_with_a_verdict_in_one_line() -> None:
    kind = job_kinds()["grip"]
    words = verdict(kind, {"outcome": "gripped", "force_held_mN": 20.0123})
    assert words == f"{OUTCOMES['gripped']}; force held 20.01 mN"
    spread = {"outcome": "lost", "force_held_mN": 20.0, "force_uncertainty_mN": 0.4123}
    assert verdict(kind, spread) == f"{OUTCOMES['lost']}; force held 20.00 ± 0.41 mN"
    assert verdict(kind, {"outcome": "no_contact", "force_held_mN": None}) == OUTCOMES["no_contact"]


def test_a_report_shows_as_many_digits_as_the_instrument_resolves() -> None:
    figures = {"x_um": 9.123456, "force_mN": 7.94126, "drift_mN": 0.0012345, "slope": 1.23456}
    page = _page({"outcome": "gripped", **figures, "sliding_in_band": 0.4123})
    shown = [page.text[page.text.index(name) + 1] for name in ("x", "force", "drift", "slope")]
    assert shown[0] == "9.123 µm"
    assert "7.94 mN" in page.text
    assert shown[2] == "0.0012 mN"
    assert shown[3] == "1.2346"
    assert "41 %" in page.text
    assert any("sliding function is within its band" in text for text in page.text)


def test_a_report_shows_requested_values_with_all_their_digits() -> None:
    page = _page(_example(GripResult), values={"force_mN": 20.125})
    assert "20.125 mN" in page.text


def test_figures_have_units() -> None:
    page = _page(_example(GripResult))
    place = page.text.index("force held")
    assert page.text[place + 1] == "19.99 mN"
    assert page.text[page.text.index("contact stiffness") + 1] == "2.10 mN/µm"
    assert page.text[page.text.index("sliding p95") + 1] == "0.320 µm"
    assert page.text[page.text.index("missed ticks") + 1] == "0"


def test_a_report_has_tables_of_course_limits_and_actions() -> None:
    result = _example(GripResult)
    result["limits_acted"] = [{"limit": "slew_up", "first_seq": 41, "samples": 3}]
    result["actions"] = []
    page = _page(result)
    assert {"Phases", "Limits that acted", "Actions", "slew_up", "41", "none"} <= set(page.text)
    assert {"start / s", "duration / s", "hold"} <= set(page.text)


def test_missing_values_are_reported() -> None:
    page = _page(_example(GripResult), state={"complete": False, "detail": "3 <lost>"})
    assert "The record is not complete: 3 <lost>" in page.text
    assert not any("not complete" in text for text in _page(_example(GripResult)).text)


def test_the_report_states_requester_and_request() -> None:
    page = _page(_example(GripResult))
    assert page.text[page.text.index("model version") + 1] == "3"
    assert page.text[page.text.index("law K P") + 1] == "1"


def test_a_missing_figure_is_shown_as_a_dash() -> None:
    page = _page({**_example(GripResult), "force_held_mN": None})
    assert page.text[page.text.index("force held") + 1] == "–"


def test_the_report_of_a_calibration_contains_its_values_and_statements() -> None:
    result = {
        "outcome": "moved",
        "statement": "the arm follows",
        "values": [{"quantity": "piezo", "value": 19.1, "uncertainty": 0.2, "unit": "µm/V"}],
        "warnings": ["rests on <compliance>"],
    }
    page = _page(result, kind=job_kinds()["calibrate"])
    assert {"the arm follows", "19.1", "µm/V", "rests on <compliance>"} <= set(page.text)
    assert "calibrate: moved" in page.text


def test_the_report_has_a_table_of_the_timing_of_the_loop() -> None:
    timing = LoopTiming.model_validate(_example(LoopTiming))
    text = _page(_example(GripResult), timing=timing).text
    begin = text.index("Timing")
    assert text[begin + 1 : begin + 9] == [
        "program",
        "quantity",
        "count",
        "p50 / s",
        "p99 / s",
        "p999 / s",
        "max / s",
        "missed",
    ]
    assert text[begin + 9 : begin + 12] == ["estimator", "lateness", "1000"]
    assert "Timing" not in _page(_example(GripResult)).text
