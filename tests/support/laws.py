"""Settings of the two laws of the paper, by short words."""

from collections.abc import Iterable

from pincette.control.laws.definition import LawDefinition, LawSettings
from pincette.control.laws.dsmifc import LAW as DSMIFC
from pincette.control.laws.parameters import ForceAge, ParameterSet
from pincette.control.laws.pbsmic import LAW as PBSMIC

LAWS: dict[str, LawDefinition] = {"pbsmic": PBSMIC, "dsmifc": DSMIFC}


def law_settings(
    scheme: str = "pbsmic",
    set: ParameterSet = "consistent",  # noqa: A002  as the rig file has it
    force_age: ForceAge = "planned",
    **gains: float,
) -> LawSettings:
    """Gains that are not given are the defaults of the consistent set."""
    law = LAWS[scheme]
    defaults = {parameter.name: parameter.default for parameter in law.parameters}
    return law.settings(set, force_age=force_age, **(defaults | gains))


GAINS = ("K_P", "K_I", "K_S", "delta", "M", "B", "K", "K_f")


def in_order(values: Iterable[float]) -> dict[str, float]:
    """Gains by name, from their values in the order of ``GAINS``."""
    return dict(zip(GAINS, values, strict=False))


def default_settings(scheme: str, parameter_set: ParameterSet) -> LawSettings:
    """Gains of a scheme where nothing else is known."""
    return LAWS[scheme].settings(parameter_set)
