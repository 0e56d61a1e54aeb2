"""Manual actions of a person on a simulated rig: parts, weights, ageing."""

import math
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Literal

from pincette.sim.plant import plant
from pincette.sim.plant.state import Event
from pincette.sim.rig.timeline import Timeline


class Orders:
    """Changes of a rig from outside, each an event; a mixin of the rig, which holds the lock."""

    def now_s(self) -> float:
        """Return the time on the rig's clock, in s."""
        raise NotImplementedError

    def _present(self) -> AbstractContextManager[Timeline]:
        raise NotImplementedError

    def place_part(self, contact_um: float | None = None) -> None:
        """Put a part between the arms, with contact at ``contact_um`` or as for the last part."""
        with self._present() as timeline:
            if contact_um is not None:
                at_um = finite("contact_um", contact_um, "µm")
                timeline.parameters = replace(timeline.parameters, contact_um=at_um)
            timeline.state = plant.place_part(timeline.parameters, timeline.state)
            at_um = timeline.parameters.contact_um
            _tell(timeline, "placed", f"a part was placed, to be touched at {at_um:.3f} µm")

    def remove_part(self) -> None:
        """Remove the part by hand."""
        self._take_part("removed", "the part was removed")

    def lose_part(self) -> None:
        """Let the part fall."""
        self._take_part("lost", "the part fell, as commanded")

    def slip_part(self, by_um: float) -> None:
        """Make the face of the part yield by a distance in µm, away from the driven arm."""
        with self._present() as timeline:
            timeline.slip(finite("slip_um", by_um, "µm"))

    def hang(self, weight_mN: float) -> None:
        """Attach a weight to the driven tip, replacing the present one; positive: towards -x."""
        with self._present() as timeline:
            hung_mN = finite("weight_mN", weight_mN, "mN")
            timeline.parameters = replace(timeline.parameters, hung_mN=hung_mN)
            _tell(timeline, "hung", f"{weight_mN:.4f} mN hang on the driven tip")

    def scale_stiffness(self, factor: float) -> None:
        """Multiply the stiffness of the passive arm by a factor from now on, not its mass."""
        with self._present() as timeline:
            p, omega = timeline.parameters, timeline.parameters.passive_natural_frequency_rad_per_s
            stiffness = p.environment_stiffness_mN_per_um * positive(factor)
            timeline.parameters = replace(
                p,
                environment_stiffness_mN_per_um=stiffness,
                passive_natural_frequency_rad_per_s=omega and omega * math.sqrt(factor),
            )
            text = f"the passive arm's stiffness is {stiffness:.4f} mN/µm, {factor:.4g} times"
            _tell(timeline, "stiffness", text)

    def scale_hysteresis(self, factor: float) -> None:
        """Multiply the hysteretic component h of the motion by a factor from now on."""
        with self._present() as timeline:
            scale = timeline.parameters.hysteresis_scale * positive(factor)
            timeline.parameters = replace(timeline.parameters, hysteresis_scale=scale)
            _tell(timeline, "hysteresis", f"the hysteresis is {scale:.4g} times the rig file's")

    def _take_part(self, what: Literal["removed", "lost"], text: str) -> None:
        with self._present() as timeline:
            timeline.state = plant.take_part(timeline.parameters, timeline.state, what)
            _tell(timeline, what, text)


def _tell(timeline: Timeline, what: str, text: str) -> None:
    timeline.events.append(Event(timeline.time_ns * 1e-9, what, text))


def finite(name: str, value: float, unit: str) -> float:
    """Return the value; raises ValueError if it is not finite."""
    if not math.isfinite(value):
        raise ValueError(f"{name} = {value} {unit}: must be finite")
    return value


def positive(factor: float) -> float:
    """Return the factor; raises ValueError if it is not positive."""
    if not 0.0 < factor < math.inf:
        raise ValueError(f"factor = {factor}: must be above 0 and finite")
    return factor
