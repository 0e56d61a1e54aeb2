"""What a voltage output's instrument does to the voltage, by its driver."""

from typing import NamedTuple

from pincette.config import ConfigError, Simulation


class OutputTraits(NamedTuple):
    """Step and first-order lag of a voltage output."""

    step_V: float
    lag_s: float


OUTPUT_TRAITS = {
    "icpdas_i7024": OutputTraits(20.0 / 2**14, 0.0033),
    "srs_dc205": OutputTraits(1e-6, 0.001),
    "nidaqmx": OutputTraits(20.0 / 2**16, 3e-6),
}
"""I-7024: 14 bit over ±10 V, 10 ms to 5 %, by its manual. DC205: its text has 1 µV; the lag is
assumed. nidaqmx: an NI-9263, 16 bit over ±10 V (20 V/2¹⁶); the lag, of its settling, is assumed."""


def resolved(simulation: Simulation, output_driver: str) -> Simulation:
    """The simulation with step and lag of the output, where it leaves them to the instrument.

    Raises
    ------
    ConfigError
        Where it does and the driver's instrument is not known.
    """
    if simulation.output_step_V is not None and simulation.output_lag_s is not None:
        return simulation
    traits = OUTPUT_TRAITS.get(output_driver)
    if traits is None:
        raise ConfigError(
            f"output.driver = {output_driver!r}: step and lag of its instrument are not known; "
            "give output_step_V and output_lag_s in [simulation]"
        )
    wanted = simulation.output_step_V, simulation.output_lag_s
    step_V, lag_s = (
        known if value is None else value for value, known in zip(wanted, traits, strict=True)
    )
    return simulation.model_copy(update={"output_step_V": step_V, "output_lag_s": lag_s})
