"""Settings of the two laws of the paper, by short names."""

from collections.abc import Iterable
from typing import Any

from pincette.control.laws.definition import LawDefinition, LawSettings
from pincette.control.laws.dsmifc import LAW as DSMIFC
from pincette.control.laws.law import Law, LawState, step
from pincette.control.laws.parameters import ForceAge, ParameterSet
from pincette.control.laws.pbsmic import LAW as PBSMIC
from pincette.control.laws.sliding import LawOutput

LAWS: dict[str, LawDefinition] = {"pbsmic": PBSMIC, "dsmifc": DSMIFC}


def law_settings(
    scheme: str = "pbsmic",
    set: ParameterSet = "consistent",  # noqa: A002  as the rig file has it
    force_age: ForceAge = "planned",
    **gains: float,
) -> LawSettings:
    """Return settings; gains that are not given are the defaults of the consistent set."""
    law = LAWS[scheme]
    defaults = {parameter.name: parameter.default for parameter in law.parameters}
    return law.settings(set, force_age=force_age, **(defaults | gains))


GAINS = ("K_P", "K_I", "K_S", "delta", "M", "B", "K", "K_f")


def in_order(values: Iterable[float]) -> dict[str, float]:
    """Return gains by name, from their values in the order of ``GAINS``."""
    return dict(zip(GAINS, values, strict=False))


def default_settings(scheme: str, parameter_set: ParameterSet) -> LawSettings:
    """Return the default gains of a scheme."""
    return LAWS[scheme].settings(parameter_set)


def step_at(
    law: Law,
    state: LawState,
    measured: tuple[float, float, float],
    wanted: tuple[float, float],
    limited: int = 0,
    **more: Any,
) -> tuple[LawState, LawOutput]:
    """Step a law with measured x in µm, F in mN and u in V, and references x_r, F_r."""
    x_um, force_mN, applied_V = measured
    x_r_um, force_r_mN = wanted
    return step(
        law,
        state,
        x_um=x_um,
        force_mN=force_mN,
        applied_V=applied_V,
        x_r_um=x_r_um,
        force_r_mN=force_r_mN,
        limited=limited,
        **more,
    )
