"""Text of the command line for a job, a plan and a problem."""

import dataclasses
import io
import re
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from pincette.api.job_kinds import job_kinds, number
from pincette.api.jobs import Job, Progress
from pincette.api.pairs import PairResult
from pincette.api.plans import MotionPlan, Plan
from pincette.api.predictions import Margin, Prediction, Violation
from pincette.api.results import MotionResult
from pincette.cli import results
from pincette.cli.results import show_plan, show_result
from pincette.cli.screen import Screen
from pincette.cli.watch import follow, left, newest, phase_of, share
from tests.unit.client import desk

LIVE = desk.example(
    Progress, phase="hold", elapsed_s=8.0, planned_s=16.0, x_um=40.25, force_mN=19.5
)
RESULT: dict[str, Any] = {
    "outcome": "gripped",
    "phases": [{"phase": "hold", "start_s": 6.8, "duration_s": 4.0}],
    "contact_x_um": 30.77,
    "contact_stiffness_mN_per_um": 2.035,
    "force_target_mN": 20.0,
    "force_held_mN": 19.34,
    "force_error_mN": -0.66,
    "force_uncertainty_mN": 1.59,
    "force_assumed": ["model.forgotten_mN"],
    "peak_force_mN": 20.09,
    "rmse_position_um": 0.196,
    "rmse_force_mN": 0.715,
    "true_force_held_mN": None,
}
UNVERIFIED = {"verified": False, "force_mN": -1.7, "uncertainty_mN": 0.4}
TRACK: dict[str, Any] = {
    "outcome": "tracked",
    "shape": "sinusoid",
    "phases": [{"phase": "track", "start_s": 9.6, "duration_s": 14.0}],
    "contact_x_um": 30.77,
    "contact_stiffness_mN_per_um": 2.035,
    "x_pp_um": 9.83,
    "force_pp_mN": 20.0,
    "position_um": {"rmse": 0.0876, "rmse_percent": 0.891, "maximum": 0.312},
    "force_mN": {"rmse": 0.19, "rmse_percent": 0.95, "maximum": 0.61},
    "true_force_mN": {"rmse": 0.3, "rmse_percent": None, "maximum": 0.8},
    "force_uncertainty_mN": 1.59,
}


def planned(**changes: Any) -> Plan:
    return Plan.model_validate(desk.example(Plan, **changes))


def job_of(**changes: Any) -> Job:
    return Job.model_validate(desk.example(Job, **changes))


def screen(*, terminal: bool) -> tuple[Console, io.StringIO]:
    out = io.StringIO()
    if not terminal:
        return Screen(out), out
    return Console(file=out, width=80, force_terminal=True, color_system=None), out


def spaced(text: str) -> str:
    """Return the text with single blanks."""
    return re.sub(" +", " ", text)


def test_a_grip_has_a_verdict_and_six_rows() -> None:
    console, out = screen(terminal=False)
    returned = {"force_mN": -0.11, "uncertainty_mN": 0.42, "x_um": 26.0, "verified": True}
    result = RESULT | {"zero_return": returned, "goal": {"met": True}}
    show_result(job_of(id="j", state="succeeded", result=result, record="data/j"), console)
    assert spaced(out.getvalue()).splitlines() == [
        "",
        "job j succeeded: gripped, goal met, force verified by the zero return",
        "",
        "force held 19.34 mN ± 1.59 mN",
        "requested force 20.00 mN",
        "peak force 20.09 mN",
        "contact stiffness 2.035 mN/µm",
        "zero return -0.11 mN ± 0.42 mN",
        "record data/j",
        "",
        "all figures: `pincette job show j --all`",
    ]


def test_a_short_result_of_two_arms_has_the_figures_of_both() -> None:
    console, out = screen(terminal=False)
    result = desk.example(PairResult, forces_agree=False)
    show_result(job_of(id="j", state="succeeded", result=result, record="data/j"), console)
    assert spaced(out.getvalue()).splitlines()[1:] == [
        "job j succeeded: tracked, the forces of both arms differ",
        "",
        "force held 15.00 mN ± 0.55 mN",
        "peak force 20.40 mN",
        "place 0.51 µm",
        "difference of both forces 0.110 mN ± 0.800 mN",
        "record data/j",
        "",
        "all figures: `pincette job show j --all`",
    ]


@pytest.mark.parametrize(
    ("members", "doubt"),
    [
        ({"goal": {"met": False}}, "goal missed"),
        ({"zero_return": UNVERIFIED}, "force not verified by the zero return"),
        (
            {"zero_return": {"verified": True}, "second_zero_return": UNVERIFIED},
            "force not verified by the zero return",
        ),
        ({"zero_unconfirmed": True}, "zero not confirmed"),
        ({"zero_invalid": True}, "zero invalid"),
        (
            {"second_stroke_change_percent": -0.9, "second_stroke_limit_percent": 0.4},
            "the second arm differs from its model",
        ),
    ],
)
def test_a_verdict_states_what_is_uncertain(members: dict[str, Any], doubt: str) -> None:
    assert results.verdict_words(RESULT | members) == ["gripped", doubt]


def test_every_figure_of_a_short_result_is_defined_by_its_kind() -> None:
    for kind in job_kinds().values():
        assert set(kind.brief) <= {figure.name for figure in kind.figures}
        for arms in kind.arms:
            assert len(kind.brief_figures_of({"arms": arms})) <= 5, kind.name  # and the record


def test_a_result_has_every_figure_with_its_unit() -> None:
    console, out = screen(terminal=False)
    job = job_of(id="j", state="succeeded", result=RESULT, record="data/j")
    show_result(job, console, everything=True)
    text = out.getvalue()
    for line in (
        "job j succeeded: gripped",
        "hold 6.80 s 4.00 s",
        "outcome gripped",
        "contact position, mean over the load 30.77 µm",
        "contact stiffness, mean over the load 2.035 mN/µm",
        "force held 19.34 mN ± 1.59 mN",
        "its ± assumes model.forgotten_mN",
        "requested force 20.00 mN",
        "force error -0.66 mN",
        "peak force 20.09 mN",
        "RMSE of the position during the hold 0.196 µm",
        "RMSE of the force during the hold 0.715 mN",
        "record data/j",
    ):
        assert line in spaced(text)
    assert "true force" not in text
    assert max(map(len, text.splitlines())) <= 80


def test_a_motion_states_its_final_position() -> None:
    console, out = screen(terminal=False)
    result = desk.example(MotionResult, drift_um=0.02, held_at_end=True)
    job = job_of(id="j", kind="move", state="succeeded", result=result, record=None)
    show_result(job, console, everything=True)
    for line in (
        "outcome moved",
        "rests at 12.51 µm",
        "final voltage 0.640 V",
        "taught as beside-the-bead",
        "target 12.50 µm",
        "target error 0.010 µm",
        "drift while held 0.020 µm",
        "part still held yes",
        "to let it go `pincette job release`",
    ):
        assert line in spaced(out.getvalue())


@pytest.mark.parametrize(
    ("kind", "rows"),
    [
        (
            "move",
            [
                "rests at 12.51 µm",
                "target 12.50 µm",
                "target error 0.010 µm",
                "final voltage 0.640 V",
                "taught as beside-the-bead",
            ],
        ),
        (
            "release",
            [
                "release sticks",
                "pull-off force 31.40 mN ± 1.30 mN",
                "remaining stiffness 1.90 mN/µm ± 0.20 mN/µm",
                "rests at 12.51 µm",
            ],
        ),
        ("hold", ["peak force 20.30 mN", "drift while held 0.020 µm", "release sticks"]),
    ],
)
def test_a_motion_has_a_verdict_and_its_main_values(kind: str, rows: list[str]) -> None:
    console, out = screen(terminal=False)
    found: dict[str, Any] = {"verdict": "sticks", "strategies": ["retreat"]}
    found |= {"stiffness_mN_per_um": 1.9, "stiffness_uncertainty_mN_per_um": 0.2}
    found |= {"pull_off_mN": 31.4, "pull_off_uncertainty_mN": 1.3}
    result = desk.example(MotionResult, drift_um=0.02, release=found)
    job = job_of(id="j", kind=kind, state="succeeded", result=result, record="data/j")
    show_result(job, console)
    verdict, _, *shown, _, more = spaced(out.getvalue()).splitlines()[1:]
    assert verdict == "job j succeeded: moved, the part sticks to the arm"
    assert shown == [*rows, "record data/j"]
    assert more == "all figures: `pincette job show j --all`"


def test_unknown_values_are_reported() -> None:
    console, out = screen(terminal=False)
    nothing: dict[str, Any] = dict.fromkeys(RESULT)
    nothing |= {"outcome": "no_contact", "phases": [], "force_target_mN": 20.0}
    job = job_of(id="j", state="failed", cause="no_contact: [x]", record=None, result=nothing)
    show_result(job, console)
    assert "no_contact: [x]" in out.getvalue()
    assert "force held" not in out.getvalue()
    show_result(job, console, everything=True)
    assert "contact position, mean over the load not known" in spaced(out.getvalue())
    assert "force held not known" in spaced(out.getvalue())
    assert "requested force 20.00 mN" in spaced(out.getvalue())


def test_a_tracked_path_has_its_errors_in_percent_of_its_height() -> None:
    console, out = screen(terminal=False)
    job = job_of(id="j", kind="track", state="succeeded", result=TRACK, record=None)
    show_result(job, console, everything=True)
    for line in (
        "shape sinusoid",
        "position, peak to peak 9.83 µm",
        "force, peak to peak 20.00 mN",
        "RMSE of the position 0.088 µm",
        "the same, as a share of its height 0.89 %",
        "largest error of the position 0.312 µm",
        "RMSE of the force 0.190 mN",
        "the same, as a share of its height 0.95 %",
        "largest error of the force 0.610 mN",
        "uncertainty of the force 1.59 mN",
        "RMSE of the true force, by the simulation 0.300 mN",
        "largest error of the true force, by the simulation 0.800 mN",
    ):
        assert line in spaced(out.getvalue())
    console, out = screen(terminal=False)
    nothing: dict[str, Any] = dict.fromkeys(TRACK)
    nothing |= {"outcome": "no_contact", "shape": "sinusoid", "phases": []}
    job = job_of(id="j", kind="track", state="failed", result=nothing, record=None)
    show_result(job, console, everything=True)
    assert "position, peak to peak not known" in spaced(out.getvalue())
    assert "RMSE of the position not known" in spaced(out.getvalue())


def test_a_result_of_another_kind_has_the_figures_that_the_kind_names(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    figures = (
        number("best.force_mN", "best force", uncertainty="best.u_mN"),
        number("drift_um", "drift", digits=3),
        number("lost_um", "lost", optional=True),
    )
    other = dataclasses.replace(job_kinds()["grip"], name="other", figures=figures)
    monkeypatch.setattr("pincette.api.job_kinds.job_kinds", lambda: {"other": other})
    result = {"outcome": "done", "best": {"force_mN": 2.0, "u_mN": 0.1}, "drift_um": None}
    assert results.result_lines(result, "other") == [
        ("outcome", "done"),
        ("best force", "2.00 mN ± 0.10 mN"),
        ("drift", "not known"),
    ]
    assert results.result_lines(result, "unknown") == [("outcome", "done")]


@pytest.mark.parametrize("name", ["grip.png", "track.png"])
def test_a_result_states_the_path_of_the_plot(tmp_path: Path, name: str) -> None:
    (tmp_path / name).touch()
    console, out = screen(terminal=False)
    job = job_of(id="j", state="succeeded", result=RESULT, record=str(tmp_path))
    show_result(job, console, everything=True)
    assert f"plot {tmp_path}/{name}" in spaced(out.getvalue())


def test_an_infeasible_plan_states_the_reason() -> None:
    console, out = screen(terminal=False)
    violation = desk.example(Violation, message="force 500 mN too much")
    show_plan(planned(feasible=False, violations=[violation]), console)
    assert "not feasible" in out.getvalue()
    assert out.getvalue().count("force 500 mN too much") == 1


def test_a_plan_states_its_prediction_and_distance_to_the_limits() -> None:
    console, out = screen(terminal=False)
    margin = desk.example(Margin)
    nearer = margin | {"distance": 1.5, "limit": 21.5}
    predicted = desk.example(
        Prediction,
        margins=[margin, nearer],
        complete=False,
        cut="only the first 120 s",
        violations=[desk.example(Violation, message="slew too high")],
    )
    show_plan(planned(prediction=predicted, feasible=False), console)
    for line in (
        "predicted           gripped after 16.42 s",
        "  force             20.16 mN at most",
        "  force left        1.5 mN to the limit 21.5 mN, at 8.86 s (load)",
        "  not all of it     only the first 120 s",
        "  slew too high",
    ):
        assert line in out.getvalue()
    assert "limit 40 mN" not in out.getvalue()


def test_a_printed_plan_names_its_law_and_its_stability_margin() -> None:
    console, out = screen(terminal=False)
    show_plan(planned(), console)
    for line in (
        "law                 DSMIFC, consistent set, K_P = 0.2, K_I = 1, K_S = 0",
        "K_f = 3500",
        "(tuned)",
        "spectral radius     0.956 in the worst case, limit 0.97",
        "feasible: 16.40 s, within every limit of the rig",
    ):
        assert line in out.getvalue()


def test_a_plan_states_the_final_position_of_the_arm() -> None:
    console, out = screen(terminal=False)
    show_plan(planned(), console)
    assert "  position          -2.13 to +1.92 µm" in out.getvalue()
    assert "  force             -7.64 to +8.46 mN, until loading" in out.getvalue()


def test_a_plan_of_a_motion_states_its_assumptions() -> None:
    console, out = screen(terminal=False)
    plan = desk.example(MotionPlan, warnings=["nobody has said that a part is held"])
    show_plan(MotionPlan.model_validate(plan), console)
    assert "note                nobody has said that a part is held" in out.getvalue()
    assert "feasible: 2.40 s" in out.getvalue()


@pytest.mark.parametrize("terminal", [False, True])
def test_a_job_is_followed_to_its_end(terminal: bool) -> None:
    console, out = screen(terminal=terminal)
    running = desk.job(state="running", progress=LIVE)
    supervisor = desk.Desk(
        desk.job(state="preparing"), running, running, desk.job(state="succeeded")
    )
    assert follow(supervisor.supervisor().job("j"), console).state == "succeeded"
    assert [one.url.params.get("wait") for one in supervisor.asked[1:]] == ["terminal"] * 3
    text = out.getvalue()
    assert "succeeded" in text
    if not terminal:
        assert text.splitlines()[1] == "  8.00 s  hold       40.25 µm  19.50 mN"
        assert len(text.splitlines()) == 3


def test_the_progress_bar_shows_phase_and_force() -> None:
    live = Progress.model_validate(LIVE)
    assert phase_of(job_of(state="running"), live) == "hold"
    assert phase_of(job_of(state="running"), None) == "running"
    assert phase_of(job_of(state="stopping"), live) == "stopping"
    assert newest(live.model_copy(update={"force_mN": None})).rstrip() == " 40.25 µm"
    assert newest(None) == ""
    assert (share(8.0, 16.0), share(17.0, 16.0), share(1.0, None)) == ("50%", "100%", "")
    assert (left(8.0, 16.0), left(17.0, 16.0), left(1.0, None)) == (
        " 8.0 s left",
        " 0.0 s left",
        "",
    )
