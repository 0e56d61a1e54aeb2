"""A control law of an external package: the how-to guide's package, planned, assessed and
played."""

import re
import sys
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pincette.config import RigFile
from pincette.config.laws import Law, law_definition
from pincette.control.arm.plant import consistent_arm
from pincette.control.laws.impedance import discrete_impedance_of
from pincette.control.laws.law import build
from pincette.control.stability.loop_matrix import law_matrix
from tests.support.command_line import request_of
from tests.support.example_packages import EXAMPLES, installed

from .harness import Harness

NAME = "example_impedance"
PAGE = EXAMPLES.parent / "how-to/add-a-law.md"
T, G_UM_PER_V = 0.02, 19.0
ARM = consistent_arm(2437.8, 0.026, G_UM_PER_V, 0.46)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return installed("law", tmp_path_factory)


@pytest.fixture(autouse=True)
def _installed(place: Path, monkeypatch: pytest.MonkeyPatch) -> Generator[None]:
    monkeypatch.setattr(sys, "path", [str(place), *sys.path])
    yield
    law_definition.cache_clear()
    sys.modules.pop("pincette_example_law", None)


def dry_run(harness: Harness, **fields: Any) -> dict[str, Any]:
    response = harness.post("/jobs", {"kind": "grip", "scheme": NAME, **fields}, dry_run="true")
    assert response.status_code == 200, response.text
    return response.json()


@pytest.mark.parametrize(
    ("language", "file"),
    [("toml", "pyproject.toml"), ("python", "pincette_example_law/__init__.py")],
)
def test_the_page_shows_the_complete_file(language: str, file: str) -> None:
    page = PAGE.read_text(encoding="utf-8")
    shown = re.findall(rf"^```{language}\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert shown[0] == (EXAMPLES / "law" / file).read_text(encoding="utf-8")


def test_rest_lists_its_name_and_its_gains(harness: Harness) -> None:
    laws = {law["scheme"]: law for law in harness.get("/laws")["laws"]}
    assert set(laws) == {"pbsmic", "dsmifc", "fpbsmic", "two_arms", NAME}
    gains = {gain["name"]: gain["default"] for gain in laws[NAME]["gains"]}
    assert gains == {"K_I": 0.3, "M": 1e-3, "B": 8.9221, "K": 1.9901e4, "K_f": 5000.0}


def test_the_loop_of_the_example_law_is_checked_before_anything_moves(harness: Harness) -> None:
    plan = dry_run(harness)
    assert plan["feasible"]
    assert plan["law"]["scheme"] == NAME
    assert plan["law"]["spectral_radius"] < plan["law"]["spectral_radius_limit"]
    fast = dry_run(harness, gains={"K_I": 1.0})
    (violation,) = fast["violations"]
    assert violation["quantity"] == "spectral_radius"
    assert fast["law"]["spectral_radius"] > 1.0


def test_the_matrix_of_the_example_law_agrees_with_its_equations() -> None:
    """From (x, F, u_{k-1}, state) to u_k: [x_{d,k} - x_{d,k-1} + K_I(x_{d,k-1} - x_{k-1})]/g."""
    settings = law_definition(NAME).settings(force_age="newest", K_I=0.4)
    law = build(settings, ARM, T, 0.0)
    matrix = law_matrix(law)
    impedance = discrete_impedance_of(settings.gains, T)
    K_bar = impedance.K_bar
    x, F, u = matrix[0, :3]
    assert (x, F) == pytest.approx((-0.4 / G_UM_PER_V, -impedance.K_f_bar / K_bar / G_UM_PER_V))
    assert u == pytest.approx(1.0)
    # Of its own state: history (5 floats), then x_d and the two deviations.
    x_d, deviation_1, deviation_2 = matrix[0, 3 + 5 : 3 + 8]
    assert (x_d, deviation_1, deviation_2) == pytest.approx(
        (
            (0.4 - 1.0) / G_UM_PER_V,
            -impedance.B_bar / K_bar / G_UM_PER_V,
            -impedance.M_bar / K_bar / G_UM_PER_V,
        )
    )
    assert np.all(matrix[0, 3 + 8 :] == 0.0)


def test_a_grip_with_this_law_holds_the_force(harness: Harness) -> None:
    job = harness.ended(harness.grip(scheme=NAME)["id"])
    assert (job["state"], job["result"]["outcome"]) == ("succeeded", "gripped"), job["cause"]
    assert job["result"]["force_held_mN"] == pytest.approx(20.0, abs=0.5)
    assert job["result"]["true_force_held_mN"] == pytest.approx(20.0, abs=1.0)
    assert job["values"]["law"]["gains"]["K_I"] == 0.3


def test_a_rig_file_may_name_the_law(
    rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    law = Law.model_validate({"scheme": NAME, "K_I": 0.2})
    named = rig_file.model_copy(update={"law": law})
    plan = open_harness(named).post("/jobs", {"kind": "grip"}, dry_run="true").json()
    assert (plan["law"]["scheme"], plan["law"]["gains"]["K_I"]) == (NAME, 0.2)


def test_a_missing_scheme_is_refused_with_the_list_of_installed_schemes(harness: Harness) -> None:
    response = harness.post("/jobs", {"kind": "grip", "scheme": "pid"})
    assert response.status_code == 422
    (error,) = response.json()["errors"]
    assert error["pointer"] == "/scheme"
    assert f"there are dsmifc, {NAME}, fpbsmic, pbsmic" in error["message"]


def test_the_command_line_sends_the_example_law_with_its_gains() -> None:
    words = ("job", "grip", "--scheme", NAME, "--gains", "K_I=0.2,K_f=4000")
    assert request_of(*words) == {"scheme": NAME, "gains": {"K_I": 0.2, "K_f": 4000.0}}
