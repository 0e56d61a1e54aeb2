"""Open-loop motions that calibrate a rig: noise, compliance, frequency response, timing.

The programs of the free response and of the contact are in ``free_response_program`` and
``contact_stiffness_program``. A motion that would exceed a limit of the rig is refused when it is
planned, before anything has moved. The motion of the arm is predicted with nominal values.
"""

from collections.abc import Sequence

from msgspec.structs import replace

from pincette.control.checks import require_positive
from pincette.control.planning.contact_plan import PlannedRig
from pincette.control.planning.path_shapes import voltage_moves
from pincette.control.planning.paths import Path
from pincette.control.planning.program import Guards, Program
from pincette.control.planning.segments import Drive, Follow, PlayedSweep, Recorded, Segment
from pincette.control.planning.sweep import Sweep

NOISE_S = 8.0
SETTLE_S, MEASURE_S = 1.5, 1.0
"""Times for each weight, in s: to settle after the weight was attached, and to measure."""
SWEEP_FROM_HZ, SWEEP_TO_HZ, SWEEP_S = 5.0, 800.0, 25.0
SWEEP_REST_S = 1.0
"""Rest before and after a sweep, in s, so that the record begins and ends at rest."""
LEAST_CAPTURE_HZ = 10_000.0

FEEL_SWINGS, FEEL_UM_PER_S = 2.0, 20.0
"""Range of the slow motion before a sweep, as a multiple of the swing predicted at resonance with
half the damping, and speed of this motion in µm/s."""

BURSTS, BURST_S, RINGS_OUT_S = 8, 0.4, 0.05
"""Number of bursts for delay and lag, duration of a burst in s, and observation time after it
in s."""
BURST_REST_S = 0.3
TAPS = (14, 15)
"""Taps of the shift register that generates the signs of a burst. The signs repeat after 2¹⁵ - 1
ticks."""

FREE = Guards(
    contact_force_mN=1.0,
    contact_samples=1,
    force_max_mN=1.0,
    lost_fraction=0.0,
    lost_samples=1,
    stiffness_min_mN_per_um=0.0,
    stiffness_max_mN_per_um=1.0,
    zero_wait_s=1.0,
)
"""Guards for a free arm. The planner of a rig adds the forces that end the motion program."""


def noise_program(duration_s: float = NOISE_S) -> Program:
    """Return a program that keeps the voltage constant to measure the noise; phase ``noise``."""
    require_positive("duration of the noise", duration_s, "s")
    return free_program(Drive("noise", duration_s))


def there_and_back(weight_mN: Sequence[float]) -> tuple[float, ...]:
    """Return the steps of a calibration by weights: 0, w_1, w_2, …, w_1, 0.

    Raises
    ------
    ValueError
        If there are fewer than two weights, the first is not 0 mN, or they do not ascend.
    """
    weights = tuple(weight_mN)
    if len(weights) < 2 or weights[0] != 0.0:
        raise ValueError(f"weights {weights} mN, must be 0 mN and at least one more")
    for index in range(1, len(weights)):
        if not weights[index] > weights[index - 1]:
            raise ValueError(
                f"weight {weights[index]} mN after {weights[index - 1]} mN: must be larger"
            )
        require_positive("weight", weights[index], "mN")
    return (*weights, *weights[-2::-1])


def compliance_program(rig: PlannedRig, weight_mN: Sequence[float]) -> Program:
    """Return a program that waits for each weight, lets it settle and measures it.

    Step n, from 1, has phases ``hang n``, which waits for ``continue``, ``settle n``,
    ``measure n``.

    Raises
    ------
    ValueError
        If the weights do not ascend from 0 mN, or the heaviest would deflect the arm beyond its
        limits of force or position.
    """
    steps = there_and_back(weight_mN)
    heaviest_mN = max(steps)
    limits = rig.limits
    require_within("weight", heaviest_mN, "mN", 0.0, limits.force_max_mN)
    sag_um = rig.compliance_um_per_mN * heaviest_mN
    require_within(
        f"position under {heaviest_mN:g} mN",
        rig.x_start_um - sag_um,
        "µm",
        limits.position_min_um,
        limits.position_max_um,
    )
    segments: list[Drive] = []
    for number in range(1, len(steps) + 1):
        segments.append(Drive(f"hang {number}", None))
        segments.append(Drive(f"settle {number}", SETTLE_S))
        segments.append(Drive(f"measure {number}", MEASURE_S))
    return Program(tuple(segments), FREE, contact_stiffness_mN_per_um=1.0)


def frequency_response_program(
    rig: PlannedRig,
    *,
    amplitude_V: float,
    damping_ratio: float,
    rate_hz: float = LEAST_CAPTURE_HZ,
    rest_V: float = 0.0,
    from_hz: float = SWEEP_FROM_HZ,
    to_hz: float = SWEEP_TO_HZ,
    duration_s: float = SWEEP_S,
) -> Program:
    """Return a swept sine about the rest voltage, captured with its drive; phase ``sweep``.

    The samples of the control loop do not resolve a swing at resonance, so no guard can stop it.
    Therefore the arm first moves slowly through twice the predicted range, phase ``feel``, where
    contact with a part ends the program.

    Raises
    ------
    ValueError
        If the sweep is impossible, captured too slowly, or would leave the limits of voltage,
        or near the resonance, where the arm moves 1/(2ζ) times as far, those of position.
    """
    zeta = require_positive("damping ratio", damping_ratio, "")
    if not rate_hz >= LEAST_CAPTURE_HZ:
        raise ValueError(f"capture at {rate_hz:g} Hz, must be at least {LEAST_CAPTURE_HZ:g} Hz")
    sweep = Sweep(from_hz, to_hz, duration_s, amplitude_V, rate_hz)
    swing_um = rig.piezo_um_per_V * amplitude_V / (2.0 * zeta)
    _require_swing(rig, "sweep", rest_V, amplitude_V, swing_um)
    feel = _feel(rig, swing_um, rest_V)
    return free_program(
        Drive("feel", feel.duration_s, courses=(Follow(feel),)),
        Drive("rest", SWEEP_REST_S),
        PlayedSweep("sweep", duration_s, sweep=sweep),
        Drive("rest", SWEEP_REST_S),
        capture_hz=rate_hz,
    )


def _require_swing(
    rig: PlannedRig, what: str, rest_V: float, amplitude_V: float, swing_um: float
) -> None:
    """Raise ValueError if a voltage, or the arm's swing at resonance, would exceed its limits."""
    limits = rig.limits
    for sign in (1.0, -1.0):
        require_voltage(rig, what, rest_V + sign * amplitude_V)
        require_within(
            f"resonance of a {what} of {amplitude_V:g} V",
            rig.x_start_um + sign * swing_um,
            "µm",
            limits.position_min_um,
            limits.position_max_um,
        )


def _feel(rig: PlannedRig, swing_um: float, rest_V: float) -> Path:
    """Return segments that move slowly through the later range of the arm and back."""
    limits = rig.limits
    most_V = (limits.position_max_um - rig.x_start_um) / rig.piezo_um_per_V
    feel_V = min(FEEL_SWINGS * swing_um / rig.piezo_um_per_V, most_V, limits.voltage_max_V - rest_V)
    rate_V_per_s = min(FEEL_UM_PER_S / rig.piezo_um_per_V, limits.slew_V_per_s)
    stops = [(rest_V, rate_V_per_s, 0.0), (rest_V + feel_V, rate_V_per_s, 0.0)]
    return voltage_moves([*stops, stops[0]])


def output_timing_program(
    rig: PlannedRig, *, amplitude_V: float, damping_ratio: float, rest_V: float = 0.0
) -> Program:
    """Return bursts of random voltage steps at each tick, phases ``burst 1``, ``burst 2``, …

    Each voltage is one amplitude above or below the rest voltage. Such a burst excites the mode and
    shows when a voltage takes effect. As before a sweep, the arm first moves slowly through its
    range.

    Raises
    ------
    ValueError
        If it would exceed the limits of voltage, position or slew rate.
    """
    zeta = require_positive("damping ratio", damping_ratio, "")
    require_positive("amplitude of the bursts", amplitude_V, "V")
    require_within(
        f"step of bursts of {amplitude_V:g} V each {rig.period_s:g} s",
        2.0 * amplitude_V / rig.period_s,
        "V/s",
        0.0,
        rig.limits.slew_V_per_s,
    )
    swing_um = rig.piezo_um_per_V * amplitude_V / (2.0 * zeta)
    _require_swing(rig, "burst", rest_V, amplitude_V, swing_um)
    ticks, after = round(BURST_S / rig.period_s), round(RINGS_OUT_S / rig.period_s)
    signs = _signs(BURSTS * ticks)
    feel = _feel(rig, swing_um, rest_V)
    segments = [Drive("feel", feel.duration_s, courses=(Follow(feel),))]
    for number in range(BURSTS):
        volts = [
            rest_V + sign * amplitude_V for sign in signs[number * ticks : (number + 1) * ticks]
        ]
        voltages_V = (*volts, *([rest_V] * after))
        duration_s = len(voltages_V) * rig.period_s
        segments.append(Drive("rest", BURST_REST_S))
        courses = (Recorded(voltages_V),)
        segments.append(Drive(f"burst {number + 1}", duration_s, courses=courses))
    segments.append(Drive("rest", BURST_REST_S))
    made = free_program(*segments)
    # A sample cannot distinguish ringing from a contact; the range was found free before.
    felt = tuple(replace(one, guarded=not one.phase.startswith("burst")) for one in made.segments)
    return replace(made, segments=felt)


def _signs(count: int) -> list[float]:
    """Return the signs of a maximal-length sequence of a linear shift register."""
    state, found = 1, list[float]()
    for _ in range(count):
        bit = (state >> (TAPS[1] - TAPS[0]) ^ state) & 1
        state = state >> 1 | bit << (TAPS[1] - 1)
        found.append(1.0 if bit else -1.0)
    return found


def free_program(*segments: Segment, capture_hz: float = 0.0) -> Program:
    """Return a program for a free arm, which ends at a contact unless a sweep is being played."""
    watched = tuple(
        replace(segment, guarded=not isinstance(segment, PlayedSweep)) for segment in segments
    )
    return Program(watched, FREE, contact_stiffness_mN_per_um=1.0, capture_hz=capture_hz)


def full_cycles(path: Path, period_s: float, last: int) -> slice:
    """Return the samples of a segment over the last whole cycles of its path at full amplitude.

    Raises
    ------
    ValueError
        If the path has fewer whole cycles.
    """
    if not 1 <= last <= path.cycles:
        raise ValueError(f"{last} cycles of {path.cycles} at full amplitude, must be 1 to all")
    end = round(path.full_to_s / period_s)
    return slice(end - round(last * path.cycle_s / period_s), end)


def require_voltage(rig: PlannedRig, what: str, voltage_V: float) -> float:
    """Return the voltage; raises ValueError if it exceeds the rig's limits."""
    limits = rig.limits
    return require_within(
        f"voltage of the {what}", voltage_V, "V", limits.voltage_min_V, limits.voltage_max_V
    )


def require_within(quantity: str, value: float, unit: str, low: float, high: float) -> float:
    """Return ``value``; raise ValueError beyond the limits, with a tolerance for rounding."""
    slack = 1e-9 * (1.0 + abs(value))
    if not low - slack <= value <= high + slack:
        raise ValueError(
            f"{quantity} = {value:.3f} {unit}, limits {low:g} {unit} to {high:g} {unit}"
        )
    return value
