"""A recorded trajectory of thousands of rows is planned and fits in one request and message."""

import json
import math
from datetime import timedelta
from decimal import Decimal
from io import BytesIO
from pathlib import Path
from typing import Any

import pyarrow.parquet
import pytest

from pincette.config import RigFile
from pincette.control.planning.segments import paths_of
from pincette.core.codec import decode, encode
from pincette.core.messages import Load
from pincette.core.number_tables import FileError
from pincette.records import number_file, parquet
from pincette_supervisor.kinds.bodies import REQUEST
from pincette_supervisor.kinds.track import POINTS_MAX
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Present
from pincette_supervisor.rest.strict_route import MEMBERS_MAX, parsed
from tests.support.command_line import request_of
from tests.support.rigs import demo_rig

from .harness import Harness
from .test_plan_warnings import TWO_ARMS

arrow: Any = pyarrow
files: Any = pyarrow.parquet
RIG = demo_rig()
MEASURED = Path(__file__).parents[4] / "shared/data/piezo-stack-hysteresis/Model_Vi_Do.dat"


def rows(count: int, name: str, low: float, high: float) -> list[dict[str, float]]:
    """A triangle of 200 rows, a period apart."""
    period_s = RIG.rig.period_s
    steps = [abs(100 - at % 200) / 100.0 for at in range(count)]
    return [
        {"t_s": round(period_s * at, 6), name: low + (high - low) * step}
        for at, step in enumerate(steps)
    ]


def knots_of(rig: RigFile, wish: dict[str, Any]) -> list[int]:
    planned = plan_job(REQUEST.validate_python(wish), rig, Present(0.0, 0.0))
    assert planned.plan.violations == []
    sent = decode(Load, encode(Load(planned.program)))
    assert sent.program == planned.program
    return [len(path.knots) for one in sent.program.segments for path in paths_of(one)]


def test_a_recorded_trajectory_of_2007_rows_is_planned() -> None:
    points = rows(2007, "force_mN", 8.0, 12.0)
    assert knots_of(RIG, {"kind": "track", "shape": "waypoints", "points": points}) == [2007]


@pytest.mark.skipif(not MEASURED.is_file(), reason=f"{MEASURED} is not there")
@pytest.mark.parametrize(
    ("member", "name", "low"), [("points", "force_mN", 8.0), ("x_points", "x_um", 34.0)]
)
def test_a_measured_path_is_stored_once(
    harness: Harness, tmp_path: Path, member: str, name: str, low: float
) -> None:
    lines = MEASURED.read_text(encoding="ascii").splitlines()[::4]  # a row each period
    um = [float(line.split()[4]) for line in lines]
    least, most = min(um), max(um)
    columns = {
        "t_s": [round(RIG.rig.period_s * at, 6) for at in range(len(um))],
        name: [low + 0.2 * (one - least) / (most - least) for one in um],
    }
    file = tmp_path / "measured.parquet"
    parquet.write(file, [parquet.Field(one, "", "", "float") for one in columns], columns, {})
    points = number_file.rows(file.read_bytes(), [*columns], "")
    option = f"--{member.replace('_', '-')}"
    typed = request_of("job", "track", "--shape", "waypoints", option, f"@{file}")
    wish = {"kind": "track", **typed}
    assert wish[member] == points
    assert knots_of(RIG, wish) == [len(um)]
    made, again = (harness.post("/trajectories", wish) for _ in range(2))
    assert (made.status_code, again.status_code) == (201, 200)
    assert made.json()["digest"] == again.json()["digest"]


def parquet_file(t_s: list[Any], x_um: list[Any]) -> bytes:
    """Return a Parquet file with columns of the types that pyarrow gives to these values."""
    file = BytesIO()
    files.write_table(arrow.table({"t_s": t_s, "x_um": x_um}), file)
    return file.getvalue()


@pytest.mark.parametrize(
    ("t_s", "x_um"),
    [([0, 1], [34, 35]), ([Decimal("0.0"), Decimal("1.0")], [Decimal("34.0"), Decimal("35.0")])],
)
def test_whole_numbers_and_decimals_of_a_parquet_file_are_read(
    t_s: list[Any], x_um: list[Any]
) -> None:
    found = number_file.rows(parquet_file(t_s, x_um), ["t_s", "x_um"], "F")
    assert found == [{"t_s": 0.0, "x_um": 34.0}, {"t_s": 1.0, "x_um": 35.0}]


@pytest.mark.parametrize(
    ("t_s", "x_um"),
    [
        ([], []),
        ([0.0, 1.0], [True, False]),
        ([0.0, 1.0], [34.0, None]),
        ([0.0, 1.0], [34.0, math.nan]),
        ([0.0, 1.0], ["34.0", "35.0"]),
        ([0.0, 1.0], [[34.0], [35.0]]),
        ([timedelta(0), timedelta(seconds=1)], [34.0, 35.0]),
    ],
)
def test_a_parquet_file_with_other_values_is_refused(t_s: list[Any], x_um: list[Any]) -> None:
    with pytest.raises(FileError):
        number_file.rows(parquet_file(t_s, x_um), ["t_s", "x_um"], "F")


@pytest.mark.parametrize(
    ("names", "named"),
    [
        (("t_ms", "x_um"), "t_ms, x_um"),
        (("t_s", "x_nm"), "t_s, x_nm"),
        (("t_s", "force_mN"), "t_s, force_mN"),
        (("t_s", "place_um"), "t_s, place_um"),
        (("T_S", "X_um"), "T_S, X_um"),
        (("t_s", "x_um", "x_um"), "x_um, x_um"),
        (("t_s", *(f"c{number}" for number in range(200))), "c8, …"),
    ],
)
def test_a_parquet_file_with_other_columns_is_refused(names: tuple[str, ...], named: str) -> None:
    file = BytesIO()
    files.write_table(arrow.table([arrow.array([0.0, 1.0])] * len(names), names=names), file)
    with pytest.raises(FileError) as refused:
        number_file.rows(file.getvalue(), ["t_s", "x_um"], "F")
    assert named in str(refused.value)
    assert "must have t_s and x_um" in str(refused.value)


@pytest.mark.parametrize("t_s", [[0.0, 2.0, 1.0], [1.0, 0.5, 0.0], [0.0, 1.0, 1.0]])
@pytest.mark.parametrize(
    ("member", "name", "low"), [("points", "force_mN", 10.0), ("x_points", "x_um", 34.0)]
)
def test_a_file_whose_times_do_not_rise_is_no_path(
    harness: Harness, t_s: list[float], member: str, name: str, low: float
) -> None:
    table = "".join(f"{at};{low + 0.1 * row}\n" for row, at in enumerate(t_s))
    points = number_file.rows(table.encode(), ["t_s", name], "F")
    wish = {"kind": "track", "shape": "waypoints", member: points}
    answer = harness.post("/jobs", wish, dry_run="true", predict="false")
    assert answer.status_code == 422, answer.text
    assert [error["pointer"] for error in answer.json()["errors"]] == [f"/{member}"]
    assert harness.post("/trajectories", wish).status_code == 422


def test_two_paths_with_the_maximum_of_points_fit_in_one_message() -> None:
    force = {"shape": "waypoints", "points": rows(POINTS_MAX, "force_mN", 8.0, 9.0)}
    place = {"shape": "waypoints", "points": rows(POINTS_MAX, "place_um", 0.0, 0.5)}
    wish = {"kind": "track", "force": force, "place": place}
    assert knots_of(TWO_ARMS, wish) == [POINTS_MAX, POINTS_MAX]


@pytest.mark.parametrize("count", [2007, POINTS_MAX])
def test_a_recorded_trajectory_is_planned_over_rest(harness: Harness, count: int) -> None:
    points = rows(count, "force_mN", 8.123456, 9.654321)
    wish = {"kind": "track", "shape": "waypoints", "points": points}
    answer = harness.post("/jobs", wish, dry_run="true", predict="false")
    assert answer.status_code == 200, answer.text[:300]
    assert answer.json()["violations"] == []


def test_two_recorded_trajectories_fit_in_one_request() -> None:
    force = {"shape": "waypoints", "points": rows(2007, "force_mN", 8.0, 9.0)}
    place = {"shape": "waypoints", "points": rows(2007, "place_um", 0.0, 0.5)}
    wish = {"kind": "track", "force": force, "place": place}
    assert parsed(json.dumps(wish).encode()) == wish


def test_only_some_of_thousands_of_wrong_points_or_members_are_reported(harness: Harness) -> None:
    wrong = [{"t": 1.0, "force": 2.0}] * POINTS_MAX
    answer = harness.post("/jobs", {"kind": "track", "shape": "waypoints", "points": wrong})
    assert answer.status_code == 422
    assert {error["pointer"].split("/")[2] for error in answer.json()["errors"]} == {"0"}
    many = {f"a{number}": 1 for number in range(MEMBERS_MAX + 1)}
    for body in (many, {"kind": "grip", "labels": many}):
        refused = harness.post("/jobs", body)
        assert refused.status_code == 413
        assert refused.json()["limit_members"] == MEMBERS_MAX
