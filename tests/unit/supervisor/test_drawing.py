"""Pictures of records: for screen and print, with errors, and distinguishable without colour."""

from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure

from pincette_supervisor.plugin import drawing

from .harness import Harness

pytestmark = pytest.mark.usefixtures("drawn")

TABLE = {
    "x_um": [1.0, 2.0, 3.0],
    "x_r_um": [1.5, 2.0, None],
    "force_mN": [4.0, 5.0, 6.0],
    "force_r_mN": [4.0, 4.0, 4.0],
    "force_uncertainty_mN": [0.1, 0.1, 0.1],
    "zero_age_s": [None, 0.0, 0.02],
    "true_force_mN": [4.1, 5.1, 6.1],
}
T_S = np.array([0.0, 0.02, 0.04])


def test_a_record_also_has_a_picture_for_print(harness: Harness) -> None:
    job = harness.ended(harness.grip(force_tolerance_mN=2.0)["id"])
    path = f"/api/v1/jobs/{job['id']}/artifacts"
    svg = harness.call("GET", f"{path}/grip.svg")
    assert svg.headers["content-type"].startswith("image/svg+xml")
    assert ElementTree.fromstring(svg.text).tag.endswith("svg")
    pdf = harness.call("GET", f"{path}/grip.pdf")
    assert pdf.headers["content-type"] == "application/pdf"
    assert pdf.content.startswith(b"%PDF")
    names = [each["name"] for each in harness.get(f"/jobs/{job['id']}/artifacts")["artifacts"]]
    assert {"grip.png", "grip.svg", "grip.pdf", "manifest.json"} <= set(names)
    manifest = harness.call("GET", f"{path}/manifest.json").json()
    assert "grip.svg" in [each["name"] for each in manifest["files"]]


def test_errors_are_drawn_with_the_tolerance_of_the_job() -> None:
    position, force = Figure().subplots(2)
    drawing.errors(position, force, T_S, TABLE, {"force_tolerance_mN": 0.8})
    drawn = [line.get_ydata() for line in position.lines if len(line.get_ydata()) == 3]
    np.testing.assert_array_equal(drawn, [[-0.5, 0.0, np.nan]])
    drawn = [line.get_ydata() for line in force.lines if len(line.get_ydata()) == 3]
    np.testing.assert_array_equal(drawn, [[np.nan, 1.0, 2.0]])
    levels = sorted(line.get_ydata()[0] for line in force.lines if len(line.get_ydata()) == 2)
    assert levels == [-0.8, 0.0, 0.8]
    assert len(position.lines) == 2


def test_lines_of_one_chart_are_distinguished_in_grey(monkeypatch: pytest.MonkeyPatch) -> None:
    styles: list[tuple[bool, bool]] = []

    def noted(*_given: object, dashed: bool = False, dotted: bool = False, **_more: object) -> None:
        styles.append((dashed, dotted))

    monkeypatch.setattr(drawing, "line", noted)
    drawing.force(Figure().subplots(), T_S, TABLE)
    assert sorted(styles) == [(False, False), (False, True), (True, False)]
