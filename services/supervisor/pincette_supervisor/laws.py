"""Which law a job runs with: scheme, parameter set and gains, and whether it may run at all."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any, NamedTuple

from pincette.config import RigFile
from pincette.config.gains import judged, tuned
from pincette.control.law import LawSettings, Scheme, default_settings
from pincette.control.stability import Assessment
from pincette_supervisor.path_requests import FaultyRequestError
from pincette_supervisor.request_models import Gains, JobRequest


class ChosenLaw(NamedTuple):
    """A law, where its gains come from, and how stable its loop is at the worst."""

    settings: LawSettings
    gains_from: str
    """``rig``, ``paper``, ``request`` or ``tuned``."""
    assessment: Assessment

    def values(self) -> dict[str, Any]:
        """As it is stored and sent with the job."""
        return {
            **asdict(self.settings),
            "gains_from": self.gains_from,
            "spectral_radius": self.assessment.radius,
            "spectral_radius_limit": self.assessment.limit_radius,
        }


def choose_law(request: JobRequest, rig: RigFile) -> ChosenLaw:
    """Complete what a request says of its law by the rig file, and judge the loop.

    Raises
    ------
    FaultyRequestError
        Where gains are to be tuned for the printed set, or none are stable.
    """
    scheme: Scheme = request.scheme or rig.law.scheme
    parameter_set = request.set or rig.law.set
    settings, origin = rig.law.settings(), "rig"
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
    return ChosenLaw(settings, origin, judged(rig, settings))


def refusals(law: ChosenLaw) -> Sequence[str]:
    """Why a law must not run; empty where it may."""
    return () if law.assessment.stable else (law.assessment.reason,)
