"""Stiffness and place of a part with a round face are means over the load, with an uncertainty."""

import pytest

from pincette.control.force.estimation import COVERAGE
from pincette.records.columns import columns
from pincette_supervisor.kinds.grip import KIND
from pincette_supervisor.plugin.result import contact_fit, load_forces
from tests.support.slips import Played, played

MODULUS_GPA = {"flat": None, "round": 0.3}
"""Effective modulus of each face. The round faces yield by about 3 µm at 20 mN (Hertz)."""


def loaded(face: str) -> Played:
    job = played({"part": {"modulus_GPa": MODULUS_GPA[face]}}, profile="gentle")
    assert job.outcome == "gripped"
    return job


@pytest.mark.parametrize("face", MODULUS_GPA)
def test_stiffness_and_place_are_means_over_2_to_20_mN_with_an_uncertainty(face: str) -> None:
    job = loaded(face)
    table = columns(job.messages, job.rig.rig.period_s)
    fit, forces = contact_fit(table), load_forces(table)
    assert fit is not None
    assert forces is not None
    assert forces.lowest_mN == pytest.approx(2.0, abs=0.5)
    assert forces.highest_mN == pytest.approx(20.0, abs=0.5)
    truths = [job.truths[view.seq].arms[0] for view in job.views if view.phase == "load"]
    first, last = truths[0], truths[-1]
    mean_mN_per_um = (last.force_mN - first.force_mN) / (last.x_um - first.x_um)
    mean_x_um = first.x_um - first.force_mN / mean_mN_per_um
    assert abs(fit.K_e_mN_per_um - mean_mN_per_um) <= COVERAGE * fit.K_e_error_mN_per_um
    assert abs(fit.x_e_um - mean_x_um) <= COVERAGE * fit.x_e_error_um
    assert fit.K_e_error_mN_per_um < 0.05 * fit.K_e_mN_per_um
    assert fit.x_e_error_um < 0.3


def test_a_round_face_is_met_before_the_mean_place_of_its_contact() -> None:
    behind_um: dict[str, float] = {}
    for face in MODULUS_GPA:
        job = loaded(face)
        met = next(one for _, one in sorted(job.truths.items()) if one.arms[0].force_mN > 0.0)
        fit = contact_fit(columns(job.messages, job.rig.rig.period_s))
        assert fit is not None
        behind_um[face] = fit.x_e_um - met.arms[0].x_um
    assert abs(behind_um["flat"]) < 0.2
    assert 0.3 < behind_um["round"] < 1.0


def test_the_result_names_an_uncertainty_of_stiffness_and_place_and_the_forces_of_the_load() -> (
    None
):
    figures = {figure.name: figure.uncertainty for figure in KIND.figures}
    assert figures["contact_stiffness_mN_per_um"] == "contact_stiffness_error_mN_per_um"
    assert figures["contact_x_um"] == "contact_x_error_um"
    assert {"contact_load.lowest_mN", "contact_load.highest_mN"} <= figures.keys()
