"""What the command line makes of a job, a plan and a problem."""

import io
from pathlib import Path
from typing import Any

import httpx
import pytest
from rich.console import Console

from pincette.cli.follow import follow, left, newest, phase_of, share
from pincette.cli.rest import Supervisor, problem_text
from pincette.cli.show import show_plan, show_result

LIVE = {"phase": "hold", "elapsed_s": 8.0, "planned_s": 16.0, "x_um": 40.25, "force_mN": 19.5}
RESULT: dict[str, Any] = {
    "outcome": "gripped",
    "phases": [{"phase": "hold", "start_s": 6.8, "duration_s": 4.0}],
    "contact_x_um": 30.77,
    "contact_stiffness_mN_per_um": 2.035,
    "force_target_mN": 20.0,
    "force_held_mN": 19.34,
    "force_error_mN": -0.66,
    "force_uncertainty_mN": 1.59,
    "peak_force_mN": 20.09,
    "rmse_position_um": 0.196,
    "rmse_force_mN": 0.715,
    "true_force_held_mN": None,
}
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
STEADY = {
    "position_min_um": -2.13,
    "position_max_um": 1.92,
    "force_min_mN": -7.64,
    "force_max_mN": 8.46,
}


class Answers(Supervisor):
    """A supervisor that gives prepared answers."""

    def __init__(self, *answers: dict[str, Any]) -> None:
        self._answers = list(answers)

    def get(self, path: str, **query: str | float) -> Any:
        assert path == "/jobs/j"
        assert query["wait"] == "terminal"
        return self._answers.pop(0)


def screen(*, terminal: bool) -> tuple[Console, io.StringIO]:
    out = io.StringIO()
    return Console(file=out, width=80, force_terminal=terminal, color_system=None), out


def test_a_result_has_every_figure_with_its_unit() -> None:
    console, out = screen(terminal=False)
    show_result({"id": "j", "state": "succeeded", "result": RESULT, "record": "data/j"}, console)
    text = out.getvalue()
    for line in (
        "job j succeeded",
        "hold    6.80 s   4.00 s",
        "outcome             gripped",
        "contact position    30.77 µm",
        "contact stiffness   2.035 mN/µm",
        "force held          19.34 mN ± 1.59 mN of 20 mN, error -0.66 mN",
        "peak force          20.09 mN",
        "RMSE over the hold  position 0.196 µm, force 0.715 mN",
        "record              data/j",
    ):
        assert line in text
    assert "true force" not in text
    assert max(map(len, text.splitlines())) <= 80


def test_what_is_not_known_is_said() -> None:
    console, out = screen(terminal=False)
    nothing: dict[str, Any] = dict.fromkeys(RESULT)
    nothing |= {"outcome": "no_contact", "phases": [], "force_target_mN": 20.0}
    job = {"id": "j", "state": "failed", "cause": "no_contact: [x]", "record": None}
    show_result(job | {"result": nothing}, console)
    assert "no_contact: [x]" in out.getvalue()
    assert "contact position    not known" in out.getvalue()
    assert "force held          not known, of 20 mN" in out.getvalue()


def test_a_tracked_path_has_its_errors_in_per_cent_of_its_height() -> None:
    console, out = screen(terminal=False)
    show_result({"id": "j", "state": "succeeded", "result": TRACK, "record": None}, console)
    for line in (
        "sinusoid            9.83 µm and 20.00 mN peak to peak",
        "position error      RMSE 0.088 µm (0.89 %), at most 0.312 µm",
        "force error         RMSE 0.190 mN (0.95 %), at most 0.610 mN",
        "force uncertainty   1.59 mN",
        "true force error    RMSE 0.300 mN, at most 0.800 mN, by the simulation",
    ):
        assert line in out.getvalue()
    console, out = screen(terminal=False)
    nothing: dict[str, Any] = dict.fromkeys(TRACK)
    nothing |= {"outcome": "no_contact", "shape": "sinusoid", "phases": []}
    show_result({"id": "j", "state": "failed", "result": nothing, "record": None}, console)
    assert "sinusoid            not tracked" in out.getvalue()
    assert "position error      not known" in out.getvalue()


@pytest.mark.parametrize("name", ["grip.png", "track.png"])
def test_the_plot_is_named_where_it_is(tmp_path: Path, name: str) -> None:
    (tmp_path / name).touch()
    console, out = screen(terminal=False)
    job = {"id": "j", "state": "succeeded", "result": RESULT, "record": str(tmp_path)}
    show_result(job, console)
    assert f"plot                {tmp_path}/{name}" in out.getvalue()


def test_a_plan_that_cannot_be_says_why() -> None:
    console, out = screen(terminal=False)
    plan = {"phases": [], "feasible": False, "violations": [{"message": "force 500 mN too much"}]}
    show_plan(plan, console)
    assert "not feasible" in out.getvalue()
    assert "force 500 mN too much" in out.getvalue()


def test_a_plan_names_its_law_and_how_stable_it_is() -> None:
    console, out = screen(terminal=False)
    law = {"scheme": "dsmifc", "set": "consistent", "gains_from": "tuned"}
    gains = {"K_P": 0.2, "K_I": 1.0, "K_S": 0.0, "K_f": 3500.0}
    radius = {"spectral_radius": 0.9559, "spectral_radius_limit": 0.97}
    plan: dict[str, Any] = {"phases": [], "feasible": True, "duration_s": 15.0}
    show_plan(plan | {"law": law | gains | radius}, console)
    for line in (
        "law                 DSMIFC, consistent set, "
        "K_P = 0.2, K_I = 1, K_S = 0, K_f = 3500 (tuned)",
        "spectral radius     0.956 at the worst, limit 0.97",
    ):
        assert line in out.getvalue()


def test_a_plan_says_where_the_arm_would_rest() -> None:
    console, out = screen(terminal=False)
    plan: dict[str, Any] = {"phases": [], "feasible": True, "duration_s": 15.0}
    show_plan(plan | {"steady_errors": STEADY}, console)
    assert "  position          -2.13 to +1.92 µm" in out.getvalue()
    assert "  force             -7.64 to +8.46 mN, until the load" in out.getvalue()
    assert max(map(len, out.getvalue().splitlines())) <= 80


@pytest.mark.parametrize("terminal", [False, True])
def test_a_job_is_followed_to_its_end(terminal: bool) -> None:
    console, out = screen(terminal=terminal)
    running = {"state": "running", "progress": LIVE}
    ended = {"state": "succeeded", "progress": None}
    assert follow(Answers({"state": "preparing"}, running, running, ended), "j", console) == ended
    text = out.getvalue()
    assert "succeeded" in text
    if not terminal:
        assert text.splitlines()[1] == "  8.00 s  hold       40.25 µm  19.50 mN"
        assert len(text.splitlines()) == 3


def test_parts_of_the_bar() -> None:
    assert phase_of({"state": "running"}, LIVE) == "hold"
    assert phase_of({"state": "stopping"}, LIVE) == "stopping"
    assert newest(LIVE | {"force_mN": None}).rstrip() == " 40.25 µm"
    assert newest({}) == ""
    assert (share(8.0, 16.0), share(17.0, 16.0), share(1.0, None)) == ("50%", "100%", "")
    assert (left(8.0, 16.0), left(17.0, 16.0), left(1.0, None)) == (
        " 8.0 s left",
        " 0.0 s left",
        "",
    )


def problem(**document: Any) -> str:
    request = httpx.Request("POST", "http://rig/api/v1/jobs")
    return problem_text(httpx.Response(422, json=document, request=request))


def test_a_problem_is_said_once() -> None:
    said = problem(
        title="The plan breaks a limit of the rig",
        detail="force 500 mN above the limit 40 mN",
        violations=[{"pointer": "/force_mN", "message": "force 500 mN above the limit 40 mN"}],
    )
    assert said == "The plan breaks a limit of the rig:\n  force 500 mN above the limit 40 mN"
    assert problem(title="Not found", detail="no job 'x'") == "Not found: no job 'x'"
    assert "status 422" in problem(odd=1)
