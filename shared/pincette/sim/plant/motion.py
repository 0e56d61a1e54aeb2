"""The arms' motion over substeps, from one way of moving to the other."""

import math
from functools import lru_cache

from pincette.sim.plant.arms import arms_of
from pincette.sim.plant.contact import static_force_mN
from pincette.sim.plant.modes import ModalSystem, Weights, deviation
from pincette.sim.plant.parameters import PlantParameters
from pincette.sim.plant.state import PlantState

PRESS_S = 0.005
"""Time constant by which the faces follow the force at rest: two periods of the first mode."""
MOST_CHANGES = 8
"""Touches and leaves within one piece; beyond, the rest of the piece goes unwatched."""
SECANTS = 4


class Motion:
    """Both arms on their way: made from a state, put back into one, of one caller alone."""

    __slots__ = ("_arms", "_dent_um", "_joined", "_lag_s", "_p", "_rest_um", "_there", "_w")

    def __init__(self, p: PlantParameters, state: PlantState, rest_um: float) -> None:
        self._p, self._arms, self._rest_um = p, arms_of(p), rest_um
        self._lag_s = p.output_lag_s + p.amplifier.lag_s
        self._there = state.part == "there" and self._arms.passive_stiffness_mN_per_um > 0.0
        self._joined, self._dent_um = state.joined and self._there, state.dent_um
        second, second_speed = state.second_um, state.second_speed_um_per_s
        self._w = self._modes(
            (state.x_um - second, second),
            (state.speed_um_per_s - second_speed, second_speed),
            (state.passive_um, state.passive_speed_um_per_s),
        )

    def tip_um(self) -> float:
        """Position x of the driven tip."""
        x_um = self._rest_um + deviation(self._system.tip, self._w)
        if self._joined:
            x_um -= self._p.compliance_um_per_mN * self._rest_force_mN(self._rest_um)
        return x_um

    def force_mN(self) -> float:
        """Contact force, negative where the part sticks and is pulled."""
        if not self._joined:
            return 0.0
        return self._rest_force_mN(self._rest_um) + deviation(self._system.watched, self._w)

    def pass_substep(self, dt_s: float, rest_um: float) -> None:
        """Let x_f go to ``rest_um`` within ``dt_s``."""
        if self._joined and self._p.part.hertz_um_per_mN23 > 0.0:
            self._press(dt_s)
        if not self._there or self._undisturbed(rest_um):
            self._take(_transition(self._p, self._joined, dt_s), rest_um)
            self._spring_back()
            return
        pieces = math.ceil(dt_s / self._arms.finest_s)
        piece_s, start_um = dt_s / pieces, self._rest_um
        for number in range(1, pieces + 1):
            way = self._approached(number * piece_s, dt_s)
            self._pass_piece(piece_s, start_um + way * (rest_um - start_um))
            self._spring_back()

    def lose_part(self) -> None:
        """Nothing to touch any more; the arms go on from where they are."""
        if self._joined:
            self._change()
        self._there, self._dent_um = False, 0.0

    def put_into(self, state: PlantState) -> PlantState:
        """The state with the arms as they are."""
        (first, second), (first_speed, second_speed), (y_um, y_speed) = self._tips()
        return state.moved(
            (first + second, first_speed + second_speed),
            (second, second_speed),
            (y_um, y_speed),
            self._joined,
            self._dent_um,
        )

    @property
    def _system(self) -> ModalSystem:
        return self._arms.joined if self._joined else self._arms.apart

    @property
    def _offset_um(self) -> float:
        """x - y at which the arms touch."""
        return self._p.contact_um + self._dent_um

    def _rest_force_mN(self, rest_um: float) -> float:
        return (rest_um - self._offset_um) / self._arms.compliance_um_per_mN

    def _rest_margin(self, rest_um: float) -> float:
        """What is left at rest until the arms touch, in µm, or leave, in mN."""
        if self._joined:
            return self._rest_force_mN(rest_um) + self._p.part.pull_off_mN
        return self._offset_um - rest_um

    def _margin(self) -> float:
        moving = deviation(self._system.watched, self._w)
        return self._rest_margin(self._rest_um) + (moving if self._joined else -moving)

    def _undisturbed(self, rest_um: float) -> bool:
        """Whether no motion within a substep can reach the end of the margin."""
        least = min(self._rest_margin(self._rest_um), self._rest_margin(rest_um))
        if least <= 0.0:
            return False
        system = self._system
        most = system.most_by_input * abs(rest_um - self._rest_um)
        for weight, w in zip(system.most_watched, self._w, strict=True):
            most += weight * abs(w)
        return most < least

    def _approached(self, time_s: float, whole_s: float) -> float:
        """Share of its way that x_f has made by a time within a step."""
        if self._lag_s <= 0.0:
            return 1.0
        return math.expm1(-time_s / self._lag_s) / math.expm1(-whole_s / self._lag_s)

    def _take(self, transition: tuple[Weights, Weights], rest_um: float) -> None:
        factors, pushes = transition
        moved_um = rest_um - self._rest_um
        self._w = [
            factor * w - push * moved_um
            for factor, w, push in zip(factors, self._w, pushes, strict=True)
        ]
        self._rest_um = rest_um

    def _pass_piece(self, dt_s: float, goal_um: float) -> None:
        """A piece in which the arms may touch or leave, more than once."""
        transition = _transition(self._p, self._joined, dt_s)
        for _ in range(MOST_CHANGES):
            start, start_um, before = self._w, self._rest_um, self._margin()
            opening = before <= 0.0 and not self._joined and self._closing_um_per_s() <= 0.0
            self._take(transition, goal_um)
            after = self._margin()
            if after >= 0.0 or opening:
                return
            times, margins = (0.0, dt_s), (before, after)
            for _ in range(SECANTS if before > 0.0 else 1):
                self._w, self._rest_um = start, start_um
                slope = (margins[1] - margins[0]) or -1.0
                moment_s = times[1] - margins[1] * (times[1] - times[0]) / slope
                moment_s = max(0.0, min(dt_s, moment_s)) if before > 0.0 else 0.0
                way_um = (goal_um - start_um) * self._approached(moment_s, dt_s)
                self._take(self._system.transition(moment_s, self._lag_s), start_um + way_um)
                times, margins = (times[1], moment_s), (margins[1], self._margin())
            self._change()
            dt_s -= times[1]
            if dt_s <= 0.0:
                break
            transition = self._system.transition(dt_s, self._lag_s)
        else:
            self._take(transition, goal_um)
        self._rest_um = goal_um

    def _closing_um_per_s(self) -> float:
        """Speed of x - y while the arms are apart."""
        system = self._arms.apart
        speeds = [rate * w for rate, w in zip(system.rates_per_s, self._w, strict=True)]
        return deviation(system.watched, speeds)

    def _change(self) -> None:
        """Touch or leave; a touch gives both tips one speed."""
        q, speeds, (y_um, y_speed) = self._tips()
        self._joined = not self._joined
        if self._joined:
            self._dent_um = q[0] + q[1] - y_um - self._p.contact_um
            impulse = self._arms.impulse_mN_s(speeds[0] + speeds[1] - y_speed)
            first, second = self._arms.inverse_masses
            speeds = speeds[0] - impulse * first, speeds[1] - impulse * second
        self._w = self._modes(q, speeds, (y_um, y_speed))

    def _press(self, dt_s: float) -> None:
        """Let the faces follow the force at rest."""
        overlap_um = self._rest_um - self._p.contact_um
        compliance = self._arms.compliance_um_per_mN
        force_mN = static_force_mN(overlap_um, compliance, self._p.part.hertz_um_per_mN23)
        goal_um = max(0.0, overlap_um - compliance * force_mN)
        moved_um = (self._dent_um - goal_um) * math.expm1(-dt_s / PRESS_S)
        self._dent_um += moved_um
        pushes = self._system.pushed_by_offset
        self._w = [w - push * moved_um for w, push in zip(self._w, pushes, strict=True)]

    def _spring_back(self) -> None:
        """Apart, the faces come out as far as the arms have opened."""
        if self._joined or self._dent_um == 0.0:
            return
        reach_um = self._rest_um + deviation(self._system.watched, self._w)
        self._dent_um = max(0.0, min(self._dent_um, reach_um - self._p.contact_um))

    def _modes(
        self, q: tuple[float, float], speeds: tuple[float, float], passive: tuple[float, float]
    ) -> list[complex]:
        """Modes of tips; of the arms joined, ``passive`` follows from the others."""
        bending = self._arms.bending_modes
        own = [[*q[:bending]], [*speeds[:bending]]]
        if not self._joined and self._arms.passive_moves:
            own = [[*values, value] for values, value in zip(own, passive, strict=True)]
        offset_um = self._offset_um if self._joined else 0.0
        return self._system.modes((*own[0], *own[1]), self._rest_um, offset_um)

    def _tips(self) -> tuple[tuple[float, float], tuple[float, float], tuple[float, float]]:
        """Positions and speeds of both bending modes, position and speed of the passive tip."""
        offset_um = self._offset_um if self._joined else 0.0
        values = self._system.state(self._w, self._rest_um, offset_um)
        half = len(values) // 2
        two = self._arms.bending_modes == 2
        q = values[0], values[1] if two else 0.0
        speeds = values[half], values[half + 1] if two else 0.0
        if self._joined:
            return q, speeds, (q[0] + q[1] - offset_um, speeds[0] + speeds[1])
        if self._arms.passive_moves:
            return q, speeds, (values[half - 1], values[-1])
        return q, speeds, (0.0, 0.0)


@lru_cache(maxsize=64)
def _transition(p: PlantParameters, joined: bool, dt_s: float) -> tuple[Weights, Weights]:
    arms = arms_of(p)
    system = arms.joined if joined else arms.apart
    return system.transition(dt_s, p.output_lag_s + p.amplifier.lag_s)
