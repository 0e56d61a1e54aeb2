"""How near the samples that are predicted come to the limits of a rig, and beyond; pure."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from pincette.api.predictions import Margin, Peaks, Quantity, Side, Violation
from pincette.config import RigFile
from pincette_supervisor.planning.predicted_samples import Samples

ROUNDING = 1e-9
"""What touches a limit is within it, rounding included."""


class Limit(NamedTuple):
    """A limit of a quantity, and the values that it holds for."""

    quantity: Quantity
    unit: str
    limit: float
    side: float
    """+1: values must not be above, -1: not below."""
    values: Sequence[float]


def rates_V_per_s(samples: Samples, period_s: float) -> list[float]:
    """Rate at which each voltage that is asked for would be come to from the one before."""
    return [
        0.0 if index == 0 else (asked_V - samples.voltage_V[index - 1]) / period_s
        for index, asked_V in enumerate(samples.asked_V)
    ]


def limits_of(rig: RigFile, samples: Samples) -> list[Limit]:
    """The limits of a rig file, each with the samples it holds for.

    Of the voltage that is what the controller asks for: the actuator keeps its limits.
    """
    limits, slew = rig.limits, rates_V_per_s(samples, rig.rig.period_s)
    return [
        Limit("force", "mN", limits.force_max_mN, 1.0, samples.force_mN),
        Limit("position", "µm", limits.position_max_um, 1.0, samples.x_um),
        Limit("position", "µm", limits.position_min_um, -1.0, samples.x_um),
        Limit("voltage", "V", limits.voltage_max_V, 1.0, samples.asked_V),
        Limit("voltage", "V", limits.voltage_min_V, -1.0, samples.asked_V),
        Limit("slew", "V/s", limits.slew_V_per_s, 1.0, slew),
        Limit("slew", "V/s", -limits.slew_V_per_s, -1.0, slew),
    ]


def margins(rig: RigFile, samples: Samples, *, switches: bool) -> list[Margin]:
    """The least distance to each limit, and to the band of the sliding function.

    Parameters
    ----------
    samples
        One at least.
    switches
        Whether the law has a switching gain K_S; without one nothing keeps s to its band.
    """
    found = [_margin(limit, samples) for limit in limits_of(rig, samples)]
    if switches:
        found.extend(_band_margin(samples))
    return found


def _margin(limit: Limit, samples: Samples) -> Margin:
    worst = max(range(len(limit.values)), key=lambda index: limit.side * limit.values[index])
    return Margin(
        quantity=limit.quantity,
        limit=limit.limit,
        nearest=limit.values[worst],
        distance=limit.side * (limit.limit - limit.values[worst]),
        unit=limit.unit,
        at_s=samples.t_s[worst],
        phase=_led(samples, worst),
    )


def _led(samples: Samples, index: int) -> str:
    """The phase that has led to a sample; its own may be what the sample has brought about."""
    return samples.phase[max(0, index - 1)]


def _band_margin(samples: Samples) -> Iterator[Margin]:
    """Of |s| to its band, where a law leads; beyond it, the law brings s back."""
    room = [band - abs(s) for s, band in zip(samples.sliding_um, samples.band_um, strict=True)]
    led = [index for index, band_um in enumerate(samples.band_um) if band_um > 0.0]
    if not led:
        return
    worst = min(led, key=room.__getitem__)
    yield Margin(
        quantity="sliding",
        limit=samples.band_um[worst],
        nearest=abs(samples.sliding_um[worst]),
        distance=room[worst],
        unit="µm",
        at_s=samples.t_s[worst],
        phase=_led(samples, worst),
    )


def violations(
    rig: RigFile, samples: Samples, pointer: Callable[[str, str], str]
) -> list[Violation]:
    """Every limit that is broken, by the phases in which that begins, in the order of the limits.

    Parameters
    ----------
    pointer
        Member of the request that leads beyond a limit, by quantity and phase.
    """
    return [
        found for limit in limits_of(rig, samples) for found in _broken(limit, samples, pointer)
    ]


def _broken(
    limit: Limit, samples: Samples, pointer: Callable[[str, str], str]
) -> Iterator[Violation]:
    begun: dict[str, int] = {}
    worst: dict[str, int] = {}
    phase: str | None = None
    for index, value in enumerate(limit.values):
        if limit.side * (value - limit.limit) <= ROUNDING:
            phase = None
            continue
        phase = _led(samples, index) if phase is None else phase
        begun.setdefault(phase, index)
        held = worst.setdefault(phase, index)
        if limit.side * (value - limit.values[held]) > 0.0:
            worst[phase] = index
    side: Side = "above" if limit.side > 0.0 else "below"
    for phase, first in begun.items():
        value, at_s = limit.values[worst[phase]], samples.t_s[first]
        yield Violation(
            pointer=pointer(limit.quantity, phase),
            quantity=limit.quantity,
            side=side,
            value=value,
            limit=limit.limit,
            unit=limit.unit,
            at_s=at_s,
            message=(
                f"predicted: {limit.quantity} {value:.3f} {limit.unit} {side} the limit "
                f"{limit.limit:g} {limit.unit}, from {at_s:.2f} s ({phase})"
            ),
        )


def peaks(rig: RigFile, samples: Samples) -> Peaks:
    """Extremes of the samples, of which there is one at least."""
    return Peaks(
        force_max_mN=max(samples.force_mN),
        x_min_um=min(samples.x_um),
        x_max_um=max(samples.x_um),
        voltage_min_V=min(samples.voltage_V),
        voltage_max_V=max(samples.voltage_V),
        slew_max_V_per_s=max(map(abs, rates_V_per_s(samples, rig.rig.period_s))),
    )
