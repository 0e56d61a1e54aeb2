"""A zero within a lane: the estimator itself takes the sample, with the past that it would have."""

from dataclasses import dataclass
from typing import Any

from msgspec.structs import replace

from pincette.control.force.contact_detector import ContactDetector
from pincette.control.response.free_response import FreeSample
from pincette.control.response.hysteresis import HysteresisState
from pincette.core.faults import Cause, Mode
from pincette.core.messages import Applied, Position
from pincette_batch.kernel.constants import Floats
from pincette_batch.kernel.lane import APPLIED, Ending, LaneRecord, X
from pincette_batch.prepared import PreparedRig

KEPT = 127
"""Samples before the newest one that the estimator keeps."""


@dataclass(frozen=True, slots=True)
class Memory:
    """The arrays that a lane writes, and its free response lives in."""

    plays_V: Floats
    creep_um: Floats
    columns: Floats
    displacements_um: Floats


class Zeroing:
    """The estimator of one lane, which sleeps from one zero to the next."""

    def __init__(self, prepared: PreparedRig) -> None:
        self._prepared = prepared
        self._state: Any = prepared.estimator.start(prepared.config)
        self._watched = 0

    def answer(self, lane: LaneRecord, memory: Memory) -> None:
        """Take in sample ``lane.tick`` with its zero; the lane may go on after, or ends."""
        tick = int(lane["tick"])
        state = self._awake(lane, memory)
        inputs = self._prepared.estimator.inputs_type(*_sample(lane))
        self._state, (estimate,) = self._prepared.estimator.step(
            self._prepared.config, state, inputs, tick * self._prepared.config.period_s
        )
        response = self._state.response
        lane["ending"] = Ending.NONE
        touch = state.contact_detector.touch
        if touch is not None and touch.on_new_ground:
            lane["ending"] = Ending.CONTACT
        elif estimate.zero_refusal or not estimate.valid:
            lane["ending"] = Ending.ZERO_REFUSED
        lane["zeroed"] = estimate.zero_age_s is not None
        lane["force_mN"], lane["offset_um"] = estimate.force_mN, response.offset_um
        lane["static_um"] = response.memory.static_um
        lane["followed_V"] = response.memory.voltage_V
        memory.plays_V[:] = response.memory.plays_V
        memory.creep_um[:] = response.memory.creep_um
        memory.displacements_um[tick] = response.sample(0.0).displacement_um
        self._watched = tick + 1

    def _awake(self, lane: LaneRecord, kept: Memory) -> Any:
        """The estimator's state before sample ``lane.tick``."""
        tick, state = int(lane["tick"]), self._state
        memory = HysteresisState(
            float(lane["followed_V"]),
            tuple(kept.plays_V.tolist()),
            float(lane["static_um"]),
            tuple(kept.creep_um.tolist()),
        )
        response = replace(state.response, memory=memory, offset_um=float(lane["offset_um"]))
        first = max(0, tick - KEPT)
        x_um, applied_V = (kept.columns[row, :tick].tolist() for row in (X, APPLIED))
        displacement_um = kept.displacements_um[:tick].tolist()
        samples = tuple(
            FreeSample(applied_V[at], x_um[at], displacement_um[at]) for at in range(first, tick)
        )
        d_p, limits, watch = (
            response.nominal_um_per_V,
            self._prepared.config.kink_limits,
            state.contact_detector,
        )
        if self._watched == 0:
            watch = ContactDetector(d_p * applied_V[0], x_um[0], free_to_um=x_um[0])
        for at in range(self._watched, tick):
            nominal_um = d_p * applied_V[at]
            # Within a step of travel it stays as it is, which is most of the time.
            if not -limits.step_um < nominal_um - watch.nominal_um < limits.step_um:
                watch = watch.follow(limits, x_um[at], nominal_um)
        return replace(
            state,
            response=response,
            epoch=1,
            followed_seq=tick - 1,
            observed_seq=tick - 1,
            free_motion=replace(state.free_motion, older=samples, newer=()),
            contact_detector=watch,
        )


def _sample(lane: LaneRecord) -> tuple[Position, Applied]:
    tick = int(lane["tick"])
    position = Position(1, tick, 0.0, float(lane["x_um"]), valid=True)
    applied = Applied(
        epoch=1,
        seq=tick - 1,
        voltage_V=float(lane["voltage_V"]),
        state=Mode.ARMED,
        cause=Cause.NONE,
        limits_active=0,
        part_held=False,
        zero=True,
        final=False,
        answered=True,
        refused=0,
        command_age_s=0.0,
    )
    return position, applied
