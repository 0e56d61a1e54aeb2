"""Rig as prepared in a laboratory: free response and contact identified, gains tuned."""

from collections.abc import Sequence
from dataclasses import dataclass

from pincette.config import IdentifiedFreeResponse, RigFile
from pincette.config.gains import tuned
from pincette.control.laws.definition import LawSettings
from pincette.core.messages import Message, Telemetry
from pincette.engine.teaching import teach
from pincette_study import printed
from pincette_study.closed_loop import StudyError, outcome, play, tracking_plan


@dataclass(frozen=True, slots=True)
class Prepared:
    """Calibrated rig file, and the identified contact."""

    rig: RigFile
    stiffness_mN_per_um: float
    contact_um: float

    def gains(self, scheme: str) -> LawSettings:
        """Return the balanced gains of a scheme on the identified model."""
        return tuned(self.rig, scheme, "consistent").chosen.settings


def prepare(rig: RigFile) -> Prepared:
    """Identify the free response of a simulated rig, then press its part once."""
    found = teach(rig)
    free_response = IdentifiedFreeResponse.from_model(found.model, found.residual_um)
    model = rig.model.model_copy(update={"free_response": free_response})
    return pressed(rig.model_copy(update={"model": model}))


def pressed(taught: RigFile) -> Prepared:
    """Press the part of a rig with an identified free response once, starting unpoled."""
    return with_line(taught, *_press(taught))


def with_line(taught: RigFile, stiffness: float, contact_um: float) -> Prepared:
    """Return the rig file with a contact line: K_e in mN/µm, x_e in µm."""
    part = taught.part.model_copy(
        update={"stiffness_mN_per_um": stiffness, "contact_um": contact_um}
    )
    return Prepared(taught.model_copy(update={"part": part}), stiffness, contact_um)


def _press(rig: RigFile) -> tuple[float, float]:
    """Return the contact line of a track's load, as identified by the controller."""
    return line_of(play(rig, tracking_plan(rig, x_pp_um=printed.X_PP_UM).program))


def line_of(messages: Sequence[Message]) -> tuple[float, float]:
    """Return K_e in mN/µm and x_e in µm, identified during a track's load; raises StudyError."""
    lines = [
        (view.contact_stiffness_mN_per_um, view.contact_x_um)
        for view in messages
        if isinstance(view, Telemetry) and view.phase == "track"
    ]
    if not lines:
        raise StudyError(f"the press to identify the contact ended {outcome(messages)!r}")
    stiffness, contact_um = lines[-1]
    if stiffness is None or contact_um is None:
        raise StudyError("the press left no contact line")
    return stiffness, contact_um
