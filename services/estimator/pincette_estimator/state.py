"""Inputs of the estimator, and its state between samples.

``StuckWatch`` finds a sensor that shows the same reading while the voltage moves. Noise makes a
laser's readings differ even at rest, but a coarse display may hide it, so a constant reading alone
proves nothing. A constant reading is a fault if the voltage should have moved the arm by much more
than the noise.
"""

from math import copysign, inf

from msgspec import field

from pincette.control.faults import Fault, FaultCode, fault
from pincette.control.force.contact_detector import ContactDetector
from pincette.control.force.observers import ForceObserver
from pincette.control.record import FrozenRecord
from pincette.control.response.free_response import FreeResponse, FreeSample
from pincette.control.response.residual_table import Residual
from pincette.control.response.reversal_memory import ReversalMemory
from pincette.control.response.stroke_check import LARGEST_CHANGE, Base, Bottom, StrokeChange
from pincette.control.response.unknown_past import UnknownPast
from pincette.control.response.voltage_memory import VoltageMemory
from pincette.core.messages import Applied, Position
from pincette_estimator.both_arms import ForceDisagreement

SURE = 3.0
"""Multiple of U above which a force before a zero is not attributed to the model error.

The zero has not removed that error yet, and U is specified for the time after a zero.
"""
NOT_TOUCHED = 1.5
"""Multiple of U that the force after a zero does not exceed without a part: 3 standard
uncertainties.
"""
SAMPLES = 8
"""Number of equal readings in a row that show a stuck sensor. With the age limit of a command the
actuator trips at the tenth."""
LATE_SAMPLES = 2
"""Number of newest voltages whose effect may not be visible yet, because of output delay, arm
and averaging."""
FREE_SAMPLES = 128
"""Number of stored samples of free motion, enough for the branch that leads to a rest."""
CHUNK = 16
PULLS = 5
"""Number of samples in a row that must read a pull. The arm of a part that is removed rings for
less than that."""
RESTS_V = 0.02
"""Width, in V, within which a law holds the voltage of an arm at rest."""
NOISES = 10.0
"""Smallest motion that the sensor shows with certainty, in standard deviations of its noise."""


def moved_V(noise_um: float, piezo_um_per_V: float) -> float:
    """Return the change of voltage, in V, that moves a free arm by ``NOISES`` standard deviations.

    The result is infinite without noise.
    """
    return NOISES * noise_um / piezo_um_per_V if noise_um > 0.0 else float("inf")


class StuckWatch(FrozenRecord, frozen=True):
    """Detector of a stuck sensor: the last reading, and the voltages since it first appeared."""

    x_um: float | None = None
    voltages_V: tuple[float, ...] = ()
    """Newest voltages, in V, at most ``SAMPLES``: a loop that holds a creeping arm still moves the
    voltage slowly."""
    stuck: bool = False
    held: bool = False
    """True if ``voltages_V`` are those of two arms that hold a part, combined by
    ``both_arms.moving_V``.
    """

    def updated(
        self, x_um: float, voltage_V: float, moved_V: float, *, held: bool = False
    ) -> "StuckWatch":
        """Add a sample, with the voltage that caused it.

        A stuck sensor stays so until its reading changes.
        """
        if x_um != self.x_um or (held != self.held and not self.stuck):
            return StuckWatch(x_um, (voltage_V,), held=held)
        voltages_V = (*self.voltages_V[1 - SAMPLES :], voltage_V)
        settled_V = voltages_V[:-LATE_SAMPLES]
        stuck = self.stuck or (
            len(voltages_V) == SAMPLES and max(settled_V) - min(settled_V) > moved_V
        )
        return StuckWatch(x_um, voltages_V, stuck, held)

    @property
    def fault(self) -> Fault | None:
        """Fault of the sensor; None if it is not stuck."""
        if not self.stuck or self.x_um is None:
            return None
        return fault(FaultCode.SENSOR_STUCK, x_um=self.x_um, samples=SAMPLES)


class FreeMotion(FrozenRecord, frozen=True):
    """The newest ``FREE_SAMPLES`` of free motion."""

    older: tuple[FreeSample, ...] = ()
    newer: tuple[FreeSample, ...] = ()
    """Newest samples, fewer than ``CHUNK``: most ticks copy only these."""

    @property
    def samples(self) -> tuple[FreeSample, ...]:
        """Kept samples, the oldest first."""
        return (*self.older, *self.newer)[-FREE_SAMPLES:]

    def rests(self, count: int) -> bool:
        """Return whether the voltage is at rest for ``count`` samples.

        The result is updated only at the end of a ``CHUNK``.
        """
        if self.newer or len(self.older) < count:
            return False
        voltages_V = [sample.voltage_V for sample in self.older[-count:]]
        return max(voltages_V) - min(voltages_V) <= RESTS_V

    def updated(self, sample: FreeSample) -> "FreeMotion":
        """Add the next sample."""
        newer = (*self.newer, sample)
        if len(newer) < CHUNK:
            return FreeMotion(self.older, newer)
        return FreeMotion((*self.older, *newer)[-FREE_SAMPLES:])


class Inputs(FrozenRecord, frozen=True):
    """Inputs: one position, and the voltage applied at the previous sample.

    ``applied`` is None if it did not arrive in time.
    """

    position: Position | None
    applied: Applied | None


class Ringing(FrozenRecord, frozen=True):
    """Oscillation of the mode after the steps of the voltage so far."""

    free_um: float = 0.0
    """Amplitude for a free arm, in µm; the amplitudes of all steps are added in quadrature."""
    part_held: bool = False


class Pressing(FrozenRecord, frozen=True):
    """Last voltages at which a held part pressed, and newest samples that a pull would need.

    A part that presses an arm cannot pull it while no arm is opened. A pull beyond the uncertainty
    of the force then shows that the zero is wrong: the part was removed and the arm has crept, or
    the sensor jumped. Once an arm is opened, a part that sticks may pull it.
    """

    voltage_V: float | None = None
    """Sum of the voltages of all arms at the newest pressing sample, in V; None before one."""
    pulls: int = 0
    """Number of newest samples in a row that read a pull at that voltage or above."""

    def updated(
        self, voltage_V: float, F_mN: float, u_F_mN: float, *, held: bool, first: bool
    ) -> "Pressing":
        """Add a sample; the first one of an epoch is at rest and counts as ``PULLS`` samples."""
        if held and F_mN > u_F_mN:
            return Pressing(voltage_V)
        if self.voltage_V is None:
            return self
        opened = voltage_V < self.voltage_V - RESTS_V
        if opened or F_mN >= -u_F_mN:
            return Pressing(self.voltage_V) if self.pulls else self
        return Pressing(self.voltage_V, PULLS if first else self.pulls + 1)


class ArmState(FrozenRecord, frozen=True):
    """Free response of an arm, the samples behind it, and the history that a force depends on."""

    response: FreeResponse
    """Free response of the arm; its memory persists over an arming, as the arm's own memory
    does."""
    model: FreeResponse
    """Initial ``response``, unpoled."""
    observer: ForceObserver
    unknown: UnknownPast
    """Possible history of the arm before the start, or since the last followed voltage."""
    followed_seq: int = -1
    """Newest sample up to which ``response`` has been updated by the voltage."""
    observed_seq: int | None = None
    """Newest sample that ``observer`` has processed; None before the first of an epoch."""
    free_motion: FreeMotion = field(default_factory=FreeMotion)
    """Recorded motion of the free arm, up to the newest sample."""
    contact_detector: ContactDetector = field(default_factory=lambda: ContactDetector(0.0, 0.0))
    """Search for a contact since the zero, or since the first sample of the epoch."""
    zero_s: float | None = None
    """Time of the zero to which the force refers, in s of this epoch; negative if a zero of an
    earlier epoch is kept for a held part, None without a zero.
    """
    zero_kept: bool = False
    """True if x_1 still goes through a zero, or a first sample, of an earlier epoch."""
    zeroed: bool = False
    """True if x_1 goes through a zero of this epoch or an earlier one; False if it goes only
    through the position where the arm was found."""
    kept_age_s: float = 0.0
    """Time that earlier epochs have played since the kept zero, in s; the pauses between the epochs
    are not known.
    """
    zero_confirmed: bool = False
    """True if other evidence than the zero itself shows that no part pressed when it was taken:
    an operator's confirmation, or a part found at its planned position later. It persists over
    an arming that keeps the zero."""
    zero_refusal: Fault | None = None
    """Reason why the last zero was refused, or why it is no longer valid; None if neither."""
    pressing: Pressing = Pressing()
    """Evidence against the zero while a part is held."""
    step_um: float = 0.0
    """Step of the position since the zero that the part or the sensor may have caused, in µm; 0
    without one."""
    zero_due_V: float | None = None
    """Voltage, in V, of a zero whose sample was not measured; None if no zero is due."""
    x_2_um: float = 0.0
    x_3_um: float = 0.0
    reversal_memory: ReversalMemory = field(default_factory=lambda: ReversalMemory(0.0))
    """Reversals of the voltage since the zero."""
    highest_V: float = 0.0
    """Highest voltage by which ``response`` has been updated since its history was unknown, in
    V."""
    missed: Residual | None = None
    """Error of x_1 at the newest tick, by the residual table; None if it is not known."""
    known_V: float = 0.0
    """Value of ``highest_V`` at the start of this epoch, in V; up to this voltage ``response``
    has the arm's memory."""
    ringing: Ringing = Ringing()
    stuck: StuckWatch = field(default_factory=StuckWatch)
    """Detector of a sensor that does not follow the voltage."""
    past: VoltageMemory = field(default_factory=VoltageMemory)
    """Voltages since the history was unknown; a changed model replays them."""
    bottom: Bottom = Bottom()
    """Rest at the bottom of the last conditioning stroke of this epoch."""
    way_base: Base | None = None
    """Rest after the conditioning strokes, at which the motion to the next zero begins; None before
    that rest.
    """
    stroke: StrokeChange | None = None
    """Newest measured change of the stroke; None if none was measured since the program started."""

    @property
    def zero_unconfirmed(self) -> bool:
        """True if the zero may hide the force of a part that pressed when it was taken."""
        return self.zero_s is not None and not self.zero_confirmed

    @property
    def invalid_zero(self) -> Fault | None:
        """Reason why the zero is no longer valid; None if it is, or if there was none."""
        refusal = self.zero_refusal
        return refusal if refusal is not None and refusal.code == FaultCode.ZERO_INVALID else None

    @property
    def missed_um(self) -> float:
        """Error of x_1, in µm, by the residual table."""
        return 0.0 if self.missed is None else self.missed.value_um

    @property
    def findings(self) -> tuple[Fault, ...]:
        """Faults of this arm that are reported."""
        stuck = self.stuck.fault
        found = () if stuck is None else (stuck,)
        if self.invalid_zero is not None:
            found = (*found, self.invalid_zero)
        if self.stroke is not None and self.stroke.significant:
            found = (*found, stroke_fault(self.stroke))
        if not self.unknown.matters(self.response):
            return found
        error_um, highest_V = self.unknown.worst_um(self.response), self.highest_V
        unknown = fault(FaultCode.MEMORY_UNKNOWN, error_um=error_um, highest_V=highest_V)
        return (*found, unknown)


class State(FrozenRecord, frozen=True):
    """State of each arm, and the state common to both."""

    arms: tuple[ArmState, ...]
    epoch: int = 0
    refused: int = 0
    apart: ForceDisagreement = field(default_factory=ForceDisagreement)
    """Mean difference between the forces of two arms, while a part is held."""

    @property
    def findings(self) -> tuple[Fault, ...]:
        """Faults of this program that are reported."""
        found = tuple(fault for arm in self.arms for fault in arm.findings)
        apart = self.apart.finding
        return found if apart is None else (*found, apart)


def stroke_fault(found: StrokeChange) -> Fault:
    """Return the fault of a stroke that has changed since the calibration."""
    return fault(
        FaultCode.MODEL_MISMATCH,
        change_percent=100.0 * found.change,
        limit_percent=100.0 * found.limit,
        most_percent=100.0 * LARGEST_CHANGE,
    )


def touched(
    state: ArmState,
    *,
    compliance_um_per_mN: float,
    step_um: float,
    x_um: float,
    F_mN: float,
    u_F_mN: float,
) -> tuple[float | None, float | None]:
    """Return where an arm that should be free met an obstacle, and the least force; or None, None.

    The largest of three forces counts. The first is the lag of the arm behind the slope of its
    motion since a kink at positions not reached before. The second is F minus ``SURE`` times U,
    with the sign of F, at voltages that x_1 has followed in an earlier arming; on the first stroke
    of an arm the error of x_1 exceeds U. After a zero, ``NOT_TOUCHED`` times U suffices for F > 0.
    The third is F if it is above U and a part may have pressed when the force was zeroed. Such a
    part causes no kink, and its force grows with each step. A straight line as model has no valid U
    in the first motion after a start, so this third force is not used with it.

    In about one motion of a hundred, noise causes a kink like that of a part, and the lag computed
    from such a kink grows with the distance. So after a zero the lag is limited to F +
    ``NOT_TOUCHED``·U, up to ``step_um`` (a step of ``KinkLimits``) beyond the voltages that x_1 has
    followed.
    """
    touch, met = state.contact_detector.touch, (None, None)
    d_p, voltage_V = state.response.nominal_um_per_V, state.response.voltage_V
    beyond_um = d_p * (voltage_V - state.known_V) if state.response.remembers else inf
    if touch is not None and touch.on_new_ground:
        lag_mN = touch.pushed_back_um(x_um, d_p * voltage_V) / compliance_um_per_mN
        if state.zero_s is not None and beyond_um <= step_um:
            lag_mN = min(lag_mN, F_mN + NOT_TOUCHED * u_F_mN)
        met = touch.x_um, max(0.0, lag_mN)
    zeroed = state.zero_s is not None and F_mN > 0.0
    sure_mN = abs(F_mN) - (NOT_TOUCHED if zeroed else SURE) * u_F_mN
    if beyond_um <= 0.0 and sure_mN > (met[1] or 0.0):
        met = x_um, copysign(sure_mN, F_mN)
    doubted = state.zero_unconfirmed and state.response.remembers
    if doubted and F_mN > max(u_F_mN, met[1] or 0.0):
        met = x_um, F_mN
    return met
