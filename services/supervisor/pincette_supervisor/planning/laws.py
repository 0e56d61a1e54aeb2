"""Which law a job runs with: scheme, parameter set and gains, and whether it may run at all."""

from dataclasses import asdict, replace
from typing import NamedTuple

from pincette.api.plan_models import GainsFrom, Law, Violation
from pincette.api.request_models import Gains, JobRequest
from pincette.config import ConfigError, RigFile
from pincette.config.gains import judged, tuned
from pincette.control.laws.law import LawSettings, Scheme, default_settings
from pincette.control.stability.assessment import Assessment
from pincette_supervisor.planning.path_requests import FaultyRequestError

SPECTRAL_RADIUS = "spectral radius"
"""Quantity of the violation that a loop which is not stable enough makes."""


class ChosenLaw(NamedTuple):
    """A law, where its gains come from, and how stable its loop is at the worst."""

    settings: LawSettings
    gains_from: GainsFrom
    assessment: Assessment

    def view(self) -> Law:
        """As it is stored with the job and sent."""
        return Law(
            **asdict(self.settings),
            gains_from=self.gains_from,
            spectral_radius=self.assessment.radius,
            spectral_radius_limit=self.assessment.limit_radius,
        )

    def violation(self) -> Violation:
        """The loop's spectral radius as a limit that a plan breaks before it begins."""
        judged = self.assessment
        return Violation(
            pointer="/gains",
            quantity=SPECTRAL_RADIUS,
            value=judged.radius,
            limit=judged.limit_radius,
            unit="",
            at_s=0.0,
            message=judged.reason,
        )


def rig_law(rig: RigFile) -> ChosenLaw:
    """The rig file's law with its gains, judged."""
    settings = rig.law.settings()
    return ChosenLaw(settings, "rig", judged(rig, settings))


def choose_law(request: JobRequest, rig: RigFile) -> ChosenLaw:
    """Complete what a request says of its law by the rig file, and judge the loop.

    Raises
    ------
    FaultyRequestError
        Where gains are to be tuned for the printed set, none are stable, or the loop of those
        given is beyond what can be reckoned.
    """
    scheme: Scheme = request.scheme or rig.law.scheme
    parameter_set = request.set or rig.law.set
    settings = rig.law.settings()
    origin: GainsFrom = "rig"
    if (scheme, parameter_set) != (settings.scheme, settings.set):
        settings = default_settings(scheme, parameter_set)
        origin = "paper" if parameter_set == "printed" else "default"
    if request.gains == "tuned":
        if parameter_set == "printed":
            raise FaultyRequestError(
                "/gains",
                'gains = "tuned" with set = "printed": gains are tuned for the consistent set',
            )
        try:
            settings, origin = tuned(rig, scheme).chosen.settings, "tuned"
        except ValueError as error:
            raise FaultyRequestError("/gains", str(error)) from error
    elif isinstance(request.gains, Gains):
        wishes = request.gains.model_dump(exclude_none=True)
        settings, origin = replace(settings, **wishes), "request"
    try:
        assessment = judged(rig, settings)
    except ConfigError:
        raise
    except ValueError as error:
        raise FaultyRequestError(
            "/gains", f"no spectral radius can be found for these gains: {error}"
        ) from error
    return ChosenLaw(settings, origin, assessment)
