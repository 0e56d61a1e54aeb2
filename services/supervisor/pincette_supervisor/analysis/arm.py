"""Noise of the sensor, compliance and mode of the arm."""

from collections.abc import Iterable
from math import pi, sqrt

import numpy as np

from pincette.control.calibration.noise import sensor_noise
from pincette.control.calibration.swept_mode import swept_mode
from pincette.control.calibration.weights import weighed_compliance
from pincette.control.planning.calibration_programs import there_and_back
from pincette.messages import Message
from pincette_supervisor.analysis.findings import Analysis, figure, identified, residuals, sure
from pincette_supervisor.analysis.samples import Samples, acquisition
from pincette_supervisor.planning.planned import Planned

SURE = 10.0
"""Standard uncertainties by which a compliance must be above 0."""


def noise(planned: Planned, taken: Samples) -> Analysis:
    """Analyse readings at rest; raises ValueError where they are too few or all the same."""
    x_um = taken.filled(taken.x_um, taken.of("noise"), "noise")
    found = sensor_noise(x_um, taken.period_s, planned.model.rig.model.force_filter_s)
    warnings = ()
    if found.quantised:
        warnings = (
            f"the step of {found.step_um:g} µm hides the noise: choose a finer display or range",
        )
    return Analysis(
        values=(identified("sensor.noise_um", found.noise_um, found.noise_uncertainty_um),),
        figures=(
            figure("step", found.step_um, "µm", "of the readings"),
            figure(
                "resolution", found.resolution_um, "µm", "smallest motion that one reading shows"
            ),
            figure(
                "filtered resolution",
                found.filtered_resolution_um,
                "µm",
                "the same, after the law's filter",
            ),
            figure("drift", found.drift_um_per_s, "µm/s", "of the readings"),
        ),
        residuals=residuals("position", "µm", found.deviation_um),
        statement=sure(
            found.noise_um,
            found.noise_uncertainty_um,
            "µm",
            "of readings about their drift; no shape of their distribution is assumed",
        ),
        drawn=found,
        warnings=warnings,
    )


def compliance(planned: Planned, taken: Samples) -> Analysis:
    """Analyse positions under weights; raises ValueError where they make no line."""
    steps = there_and_back(planned.values["weights_mN"])
    x_um: list[float] = []
    t_s: list[float] = []
    scatter: list[float] = []
    for number in range(1, len(steps) + 1):
        place = taken.of(f"measure {number}")
        values = taken.filled(taken.x_um, place, f"weight {number}")
        x_um.append(float(np.mean(values)))
        t_s.append(0.5 * (place.start + place.stop) * taken.period_s)
        scatter.append(float(np.std(values)) / sqrt(len(values)))
    found = weighed_compliance(
        steps,
        x_um,
        t_s,
        noise_um=sqrt(float(np.mean(np.square(scatter)))),
        weight_uncertainty=planned.values["weight_uncertainty"],
    )
    s_p, u = found.compliance_um_per_mN, found.uncertainty_um_per_mN
    if s_p < SURE * u:
        raise ValueError(
            f"compliance of {s_p:.4f} µm/mN with a standard uncertainty of {u:.4f} µm/mN, must be "
            f"{SURE:g} times that at least: were the weights hung as they were asked for?"
        )
    return Analysis(
        values=(identified("model.compliance_um_per_mN", s_p, u),),
        figures=(
            figure("rest", found.rest_um, "µm", "without a weight"),
            figure("drift", found.drift_um_per_s, "µm/s", "of the arm"),
        ),
        residuals=residuals("position", "µm", found.residuals_um),
        statement=sure(s_p, u, "µm/mN", "of scatter about the line and of the weights as stated"),
        drawn=found,
    )


def frequency_response(planned: Planned, messages: Iterable[Message]) -> Analysis:
    """Analyse a sweep; raises ValueError where it shows no resonance."""
    acquired = acquisition(messages)
    if acquired is None:
        raise ValueError("the sensor has acquired nothing from its buffer")
    values = planned.values
    found = swept_mode(
        acquired.drive_V,
        acquired.x_um,
        acquired.rate_hz,
        from_hz=values["from_hz"],
        to_hz=values["to_hz"],
    )
    model = found.model
    omega_n, u = model.natural_frequency_rad_per_s, model.natural_frequency_uncertainty_rad_per_s
    return Analysis(
        values=(
            identified("model.natural_frequency_rad_per_s", omega_n, u),
            identified("model.damping_ratio", model.damping_ratio, model.damping_ratio_uncertainty),
        ),
        figures=(
            figure("natural frequency", omega_n / (2.0 * pi), "Hz", "of the mode"),
            figure(
                "small-signal gain",
                found.small_signal_gain_um_per_V,
                "µm/V",
                f"at {values['amplitude_V']:g} V, below d_p for the hysteresis",
            ),
            figure("delay", 1e3 * found.delay_s, "ms", "from drive to reading"),
            figure(
                "coherence",
                found.coherence,
                "1",
                "share of the motion that the drive explains, median",
            ),
        ),
        residuals=residuals("log of the gain", "1", model.residuals),
        statement=sure(omega_n, u, "rad/s", "of the scatter of the gain about the model"),
        drawn=found,
    )
