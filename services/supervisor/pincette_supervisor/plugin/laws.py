"""Law of a job: its scheme, parameter set and gains, and whether it may run."""

from dataclasses import replace
from math import inf
from typing import Any, NamedTuple

from pincette.api.plans import GainsFrom, Law
from pincette.api.predictions import Quantity, Violation
from pincette.api.requests import ContactJobRequest, Gains
from pincette.config import ConfigError, RigFile
from pincette.config.gains import judged, tuned
from pincette.config.laws import law_definition
from pincette.control.laws.definition import LawSettings
from pincette.control.stability.assessment import Assessment
from pincette.control.stability.two_arms import TwoArmAssessment
from pincette_supervisor.plugin import FaultyRequestError

SPECTRAL_RADIUS: Quantity = "spectral_radius"
SENSITIVITY_PEAK: Quantity = "sensitivity_peak"
"""Quantity of the violation of a loop that is not stable enough."""


class ChosenLaw(NamedTuple):
    """A law, the source of its gains, and the stability of its loop in the worst case."""

    settings: LawSettings
    gains_from: GainsFrom
    assessment: Assessment

    def view(self) -> Law:
        """Return the law as it is stored with the job and sent."""
        return Law(
            scheme=self.settings.scheme,
            set=self.settings.set,
            gains=self.settings.gains,
            force_age=self.settings.force_age,
            gains_from=self.gains_from,
            **judgement(self.assessment),
        )


def judgement(judged: Assessment | TwoArmAssessment) -> dict[str, Any]:
    """Return the worst-case stability of a loop, by members of ``Law``."""
    peaks = judged.sensitivity_peak, judged.limit_peak
    peak, limit_peak = (value if value < inf else None for value in peaks)
    return {
        "spectral_radius": judged.radius,
        "spectral_radius_limit": judged.limit_radius,
        "sensitivity_peak": peak,
        "sensitivity_peak_limit": limit_peak,
    }


def unstable(judged: Assessment | TwoArmAssessment) -> list[Violation]:
    """Return the violation of a loop that is not stable enough; empty if it is stable."""
    if not judged.reason:
        return []
    quantity, value, limit = SPECTRAL_RADIUS, judged.radius, judged.limit_radius
    if value < limit and judged.sensitivity_peak > judged.limit_peak:
        quantity, value, limit = SENSITIVITY_PEAK, judged.sensitivity_peak, judged.limit_peak
    elif value < limit and isinstance(judged, TwoArmAssessment):
        value, limit = judged.uninformed_radius, judged.limit_uninformed_radius
    return [
        Violation(
            pointer="/gains",
            quantity=quantity,
            side="above",
            value=value,
            limit=limit,
            unit="",
            at_s=0.0,
            message=judged.reason,
        )
    ]


def rig_law(rig: RigFile) -> ChosenLaw:
    """Return the rig file's law with its gains and its stability."""
    settings = rig.law_settings
    return ChosenLaw(settings, "rig", judged(rig, settings))


def choose_law(request: ContactJobRequest, rig: RigFile) -> ChosenLaw:
    """Complete the law of a request from the rig file, and assess the stability of its loop.

    Raises
    ------
    FaultyRequestError
        If the law is not installed or has no such gain; if the identified set is requested without
        an identified response; if gains are to be tuned for the printed set; if no gains are
        stable; or if the stability with the given gains cannot be computed.
    """
    scheme = request.scheme or rig.law.scheme
    parameter_set = request.set or rig.law_set
    if parameter_set == "identified" and rig.model.free_response is None:
        raise FaultyRequestError(
            "/set" if request.set else "",
            'set = "identified": the model in use has no identified free response; '
            'calibrate free_response, or use set = "consistent"',
        )
    settings = rig.law_settings
    origin: GainsFrom = "rig"
    if (scheme, parameter_set) != (settings.scheme, settings.set):
        try:
            settings = law_definition(scheme).settings(parameter_set)
        except ValueError as error:
            raise FaultyRequestError("/scheme", f"scheme = {scheme!r}: {error}") from error
        origin = "paper" if parameter_set == "printed" else "default"
    if request.gains == "tuned":
        if parameter_set == "printed":
            raise FaultyRequestError(
                "/gains",
                'gains = "tuned" with set = "printed": gains can be tuned for the sets '
                '"consistent" and "identified" only',
            )
        try:
            settings, origin = tuned(rig, scheme, parameter_set).chosen.settings, "tuned"
        except ValueError as error:
            raise FaultyRequestError("/gains", str(error)) from error
    elif isinstance(request.gains, Gains):
        settings, origin = _with_gains(settings, request.gains), "request"
    try:
        assessment = judged(rig, settings)
    except ConfigError:
        raise
    except ValueError as error:
        raise FaultyRequestError(
            "/gains", f"the spectral radius for these gains cannot be computed: {error}"
        ) from error
    return ChosenLaw(settings, origin, assessment)


def _with_gains(settings: LawSettings, gains: Gains) -> LawSettings:
    """Return the settings with the requested gains; raises FaultyRequestError."""
    if gains.force_age is not None:
        settings = replace(settings, force_age=gains.force_age)
    for name, value in gains.by_name.items():
        try:
            settings = settings.with_gains(**{name: value})
        except ValueError as error:
            place = name.replace("~", "~0").replace("/", "~1")
            raise FaultyRequestError(f"/gains/{place}", str(error)) from error
    return settings
