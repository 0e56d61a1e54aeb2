"""Actions of a person on a simulated rig of two arms."""

from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Literal

from pincette.control.record import replace
from pincette.sim.plant.pair import advance_pair
from pincette.sim.plant.pair_state import (
    APART,
    PairParameters,
    PairState,
    pair_forces_mN,
    part_gone,
)
from pincette.sim.plant.state import Event, newest_events
from pincette.sim.rig.commands import Orders, finite, positive


@dataclass(slots=True)
class PairTimeline:
    """State of both arms and the part, and the time that it belongs to."""

    parameters: PairParameters
    state: PairState
    time_ns: int = 0
    slipped: int = 0
    """Number of times that the part has yielded to its force."""

    def pass_to(self, end_ns: int, dt_s: float) -> None:
        """Advance by ``dt_s``, until ``end_ns``, in short steps if the part may yield."""
        substep_s = self.parameters.first.substep_s
        while self.slipped < self.parameters.part.slips and dt_s > substep_s:
            self._advance(substep_s)
            dt_s -= substep_s
        self._advance(dt_s)
        self.time_ns = end_ns

    def slip(self, by_um: float) -> None:
        """Make the part narrower by a distance in µm."""
        gap_um = self.parameters.gap_um + by_um
        self.parameters = replace(self.parameters, gap_um=gap_um)
        _tell(
            self, "slipped", f"the part gave way by {by_um:.3f} µm, the arms meet {gap_um:.3f} µm"
        )

    def _advance(self, dt_s: float) -> None:
        self.state = advance_pair(self.parameters, self.state, dt_s)
        part = self.parameters.part
        if self.slipped >= part.slips or self.state.part != "there":
            return
        if min(pair_forces_mN(self.parameters, self.state)) > part.slip_mN:
            self.slipped += 1
            self.slip(part.slip_um)


class PairOrders(Orders):
    """Changes of a pair from outside, each an event; a mixin of the rig, which holds the lock."""

    def _present(self) -> AbstractContextManager[PairTimeline]:  # pyright: ignore[reportIncompatibleMethodOverride]
        raise NotImplementedError

    def place_part(self, contact_um: float | None = None) -> None:
        """Put a part on the ground, with contact of the first arm at ``contact_um``.

        Raises
        ------
        ValueError
            If the arms are too close for the part.
        """
        with self._present() as timeline:
            state, gap_um = timeline.state, timeline.parameters.gap_um
            wanted_um = timeline.parameters.part_um if contact_um is None else contact_um
            at_um, (x_1, x_2) = finite("contact_um", wanted_um, "µm"), state.tips_um
            if x_1 > at_um or x_2 > gap_um - at_um:
                raise ValueError(
                    f"the arms are at {x_1:.2f} µm and {x_2:.2f} µm, the part allows at most "
                    f"{at_um:.2f} µm and {gap_um - at_um:.2f} µm: open the gripper first"
                )
            placed = replace(
                state, part="there", part_um=at_um, anchor_um=at_um, contact=APART, held_s=0.0
            )
            timeline.state = placed
            _tell(timeline, "placed", f"a part was placed, to be touched at {at_um:.3f} µm")

    def slip_part(self, by_um: float) -> None:
        """Make the part narrower by a distance in µm."""
        with self._present() as timeline:
            timeline.slip(finite("slip_um", by_um, "µm"))

    def hang(self, weight_mN: float) -> None:
        """Attach a weight to the first tip, replacing the present one; positive: towards -x."""
        with self._present() as timeline:
            first = replace(timeline.parameters.first, hung_mN=finite("weight_mN", weight_mN, "mN"))
            timeline.parameters = replace(timeline.parameters, first=first)
            _tell(timeline, "hung", f"{weight_mN:.4f} mN hang on the first tip")

    def scale_stiffness(self, factor: float) -> None:
        """Multiply the stiffness of the part's faces by a factor from now on."""
        with self._present() as timeline:
            stiffness = timeline.parameters.face_mN_per_um * positive(factor)
            timeline.parameters = replace(timeline.parameters, face_mN_per_um=stiffness)
            text = f"each face's stiffness is {stiffness:.4f} mN/µm, {factor:.4g} times"
            _tell(timeline, "stiffness", text)

    def scale_hysteresis(self, factor: float) -> None:
        """Multiply the hysteretic component of the first arm's motion by a factor from now on."""
        with self._present() as timeline:
            first = timeline.parameters.first
            scale = first.hysteresis_scale * positive(factor)
            timeline.parameters = replace(
                timeline.parameters, first=replace(first, hysteresis_scale=scale)
            )
            text = f"the first arm's hysteresis is {scale:.4g} times the rig file's"
            _tell(timeline, "hysteresis", text)

    def _take_part(self, what: Literal["removed", "lost"], text: str) -> None:
        with self._present() as timeline:
            timeline.state = part_gone(timeline.state, what)
            _tell(timeline, what, text)


def _tell(timeline: PairTimeline, what: str, text: str) -> None:
    event = Event(timeline.time_ns * 1e-9, what, text)
    timeline.state = replace(timeline.state, events=newest_events(timeline.state.events, event))
