"""One arm and the part that it meets, with the assumptions of a plan.

The voltage is computed from the free displacement x - x_start + s_p·F, by the identified free
response if there is one, otherwise by

    u = (x - x_start + s_p·F)/d_p,  in contact F = K_e·(x - x_e)

At ``x_start_um`` the voltage is 0.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Self

from pincette.control.planning.conditioning import PHASE as CONDITION
from pincette.control.planning.contact_line import LoadLine
from pincette.control.planning.prediction import Course, Piece, nominal, sample_course
from pincette.control.planning.segments import Entry, Reference, Seek, Segment
from pincette.control.response.hysteresis import (
    HysteresisModel,
    HysteresisState,
    displacement_um,
    start,
)
from pincette.control.response.hysteresis import step as state_after
from pincette.control.response.inverse import free_voltages

HOME_SHARE = 0.5
"""Fraction of the voltage range below 0 V that the return may use. The rest of this range is
reserved for errors of the model and undetected drift."""
SWEPT_STEPS, SWEPT_STEP_S = 50, 0.04
"""Number of steps in which a model is moved to a position or voltage, and duration of each step in
s."""
SHAKEN_V, SHAKES = 0.02, 25
"""Peak-to-peak voltage, in V, and number of the small swings that the law makes because of noise
while the arm presses."""


@dataclass(frozen=True, slots=True)
class PlannedArm:
    """The arm and the part that it meets, as a plan assumes them."""

    x_start_um: float
    """Position at which the arm rests at zero voltage, in µm."""
    piezo_um_per_V: float
    """Piezoelectric constant d_p, in µm/V."""
    compliance_um_per_mN: float
    """Compliance s_p of the arm, in µm/mN."""
    contact_um: float
    """Position x_e of first contact, in µm."""
    stiffness_mN_per_um: float
    """Contact stiffness K_e, in mN/µm."""
    free_response: HysteresisModel | None = None
    """Identified free response; None: a straight line of slope d_p."""
    memory: HysteresisState | None = None
    """Memory of the free response at the start; None: the arm is unpoled."""

    def pressed_um(self, force_mN: float) -> float:
        """Return the position x = x_e + F/K_e at which the contact bears a force."""
        return self.contact_um + force_mN / self.stiffness_mN_per_um

    def voltages_V(
        self, x_um: Sequence[float], force_mN: Sequence[float], period_s: float
    ) -> list[float]:
        """Return the voltages for the given positions and forces, one per period."""
        free_um = [
            x - self.x_start_um + self.compliance_um_per_mN * force
            for x, force in zip(x_um, force_mN, strict=True)
        ]
        if self.free_response is None:
            return [displacement / self.piezo_um_per_V for displacement in free_um]
        return free_voltages(self.free_response, free_um, period_s, self.memory)

    def _way_back_um(
        self, x_um: float, force_mN: float, voltages_V: Sequence[float]
    ) -> list[float]:
        """Return the positions of the free arm at falling voltages after a press.

        Because of remanence, an arm with an identified free response stays above its earlier
        position.
        """
        model = self.free_response
        if model is None:
            return [self.x_start_um + self.piezo_um_per_V * to_V for to_V in voltages_V]
        begins, memory = self._moved(model, x_um, force_mN)
        start_um, places_um = displacement_um(model, begins), list[float]()
        for to_V in voltages_V:
            memory = swept(model, memory, to_V)[-1]
            places_um.append(self.x_start_um + displacement_um(model, memory) - start_um)
        return places_um

    def home_um(
        self,
        furthest_um: float,
        highest_mN: float,
        *,
        stand_off_um: float,
        voltage_min_V: float,
        rest_um: float | None = None,
    ) -> float:
        """Return the position to which the arm returns after it has pressed a part.

        It is ``x_start_um`` if the arm is certain to reach it, otherwise the position at which the
        arm rests at 0 V. Because of remanence an arm stays above its earlier rest position, by 7 µm
        and more if relays are far from saturation, and the sensor reading drifts. A return to
        ``x_start_um`` could then need a voltage below the limits and end with a following error.

        Parameters
        ----------
        furthest_um, highest_mN
            Furthest position and highest force of the plan.
        stand_off_um
            Position in front of the part; home is never beyond it.
        voltage_min_V
            Lower limit of the voltage.
        rest_um
            Position reading at rest at 0 V at the start of the plan; None: not known.
        """
        low_V = min(0.0, HOME_SHARE * voltage_min_V)
        at_rest_um, lowest_um = self._way_back_um(furthest_um, highest_mN, (0.0, low_V))
        reach_um = at_rest_um - lowest_um
        if rest_um is not None:
            at_rest_um = max(at_rest_um, rest_um)
        if at_rest_um - reach_um <= self.x_start_um:
            return self.x_start_um
        return max(self.x_start_um, min(at_rest_um, stand_off_um))

    def swing_um(self, x_um: float, force_mN: float, swing_V: float, cycles: int) -> float:
        """Return how far the free arm moves back during small swings of the voltage, in µm.

        Before the swings, the law converts the sensor's noise to small reversals of the voltage. An
        arm whose memory decays with the distance travelled moves back further after these
        reversals.

        Parameters
        ----------
        x_um, force_mN
            Position and force at which the swings begin. The voltage there is their crest.
        swing_V
            Peak-to-peak voltage of the swings.
        cycles
            Number of swings. Many actuators settle to a new loop only after several swings.
        """
        model = self.free_response
        if model is None:
            return self.piezo_um_per_V * swing_V
        _, memory = self._moved(model, x_um, force_mN)
        memory = _shaken(model, memory)
        crest_V, lowest_um = memory.voltage_V, displacement_um(model, memory)
        crest_um = lowest_um
        for _ in range(cycles):
            for to_V in (crest_V - swing_V, crest_V):
                states = swept(model, memory, to_V)
                memory = states[-1]
                lowest_um = min(lowest_um, *(displacement_um(model, one) for one in states))
        return crest_um - lowest_um

    def _moved(
        self, model: HysteresisModel, x_um: float, force_mN: float
    ) -> tuple[HysteresisState, HysteresisState]:
        """Return the memory at the start of the plan, and after a motion to a position and
        force.
        """
        begins = start(model) if self.memory is None else self.memory
        way_um = x_um - self.x_start_um + self.compliance_um_per_mN * force_mN
        ways_um = [way_um * step / SWEPT_STEPS for step in range(1, SWEPT_STEPS + 1)]
        memory = begins
        for voltage_V in free_voltages(model, ways_um, SWEPT_STEP_S, begins):
            memory = state_after(model, memory, voltage_V, SWEPT_STEP_S)
        return begins, memory

    def entry(self, x_um: float, period_s: float) -> Entry:
        """Return the entry state of a plan that begins with the arm at rest at a position."""
        begin_V = (x_um - self.x_start_um) / self.piezo_um_per_V
        return Entry(Reference(x_um, voltages_V=(begin_V,)), period_s)

    def touched(self, entry: Entry, force_mN: float, rate_mN_per_s: float = 0.0) -> Entry:
        """Return the state at the end of a seek in which the arm has met the part with a force."""
        ref = entry.ref._replace(
            x_um=self.pressed_um(force_mN), force_mN=force_mN, force_rate_mN_per_s=rate_mN_per_s
        )
        return entry._replace(ref=ref, line=LoadLine(self.contact_um, self.stiffness_mN_per_um))

    def follow(self, segment: Segment, entry: Entry, ref: Reference) -> Reference:
        """Return complete references of a sample.

        During a seek the force is computed from the contact line. In a segment without a law the
        position is computed from the voltage.
        """
        if isinstance(segment, Seek):
            pressed_um = ref.x_um - self.contact_um
            return ref._replace(force_mN=max(0.0, self.stiffness_mN_per_um * pressed_um))
        return nominal(self.piezo_um_per_V, segment, entry, ref) if segment.open_loop else ref

    def course(self, pieces: Sequence[Piece], period_s: float) -> Course:
        """Return the predicted course of a plan; raises ValueError if the period is not positive.

        While a law drives the arm, the voltages are computed by the free response. Conditioning
        strokes between such motions keep their own voltages, and change the memory.
        """
        course = sample_course(pieces, period_s)
        starts_s = [piece.start_s for piece in pieces]
        law_s = next(piece.start_s for piece in pieces if not piece.segment.open_loop)

        def strokes_at(tick: int) -> Piece | None:
            piece = pieces[bisect_right(starts_s, course.t_s[tick]) - 1]
            return piece if piece.segment.phase == CONDITION else None

        begin, arm = sum(t_s < law_s for t_s in course.t_s), self
        last_V = course.voltage_V[begin - 1] if begin else 0.0
        for strokes, ticks in groupby(range(begin, len(course.t_s)), strokes_at):
            part = slice(begin, begin + sum(1 for _ in ticks))
            x_um, force_mN = course.x_r_um[part], course.force_r_mN[part]
            if strokes is not None:
                course.voltage_V[part] = _stroke_V(strokes, course.t_s[part], last_V)
            else:
                if arm is not self:  # a law begins at the position of the arm
                    pressed_um = arm.compliance_um_per_mN * force_mN[0]
                    arm = replace(arm, x_start_um=x_um[0] + pressed_um)
                course.voltage_V[part] = arm.voltages_V(x_um, force_mN, period_s)
            begin, last_V = part.stop, course.voltage_V[part.stop - 1]
            if begin < len(course.t_s):
                arm = arm._after(course.voltage_V[part], period_s)
        return course

    def _after(self, voltages_V: Sequence[float], period_s: float) -> Self:
        """Return the arm with its memory after these voltages, one per period."""
        model = self.free_response
        if model is None:
            return self
        memory = start(model) if self.memory is None else self.memory
        for voltage_V in voltages_V:
            memory = state_after(model, memory, voltage_V, period_s)
        return replace(self, memory=memory)


def _stroke_V(piece: Piece, t_s: Sequence[float], last_V: float) -> list[float]:
    """Return the voltages of a segment without a law that begins at ``last_V``."""
    entry = piece.entry._replace(ref=piece.entry.ref._replace(voltages_V=(last_V,)))
    refs = [piece.segment.reference(at_s - piece.start_s, entry) for at_s in t_s]
    return [ref.voltages_V[0] for ref in refs]


def _shaken(model: HysteresisModel, memory: HysteresisState) -> HysteresisState:
    """Return the memory after small swings about the present voltage."""
    about_V = memory.voltage_V
    for _ in range(SHAKES):
        for off_V in (-0.5 * SHAKEN_V, 0.5 * SHAKEN_V):
            memory = state_after(model, memory, about_V + off_V, 0.0)
    return state_after(model, memory, about_V, 0.0)


def swept(model: HysteresisModel, memory: HysteresisState, to_V: float) -> list[HysteresisState]:
    """Return the memories during a motion to a voltage."""
    from_V, states = memory.voltage_V, list[HysteresisState]()
    for step in range(1, SWEPT_STEPS + 1):
        voltage_V = from_V + (to_V - from_V) * step / SWEPT_STEPS
        memory = state_after(model, memory, voltage_V, SWEPT_STEP_S)
        states.append(memory)
    return states
