"""Simulated NI-DAQmx devices behind a simulated device server."""

from pincette.config import ConfigError
from pincette.sim.instruments.fitting import Fitted, OutputTraits, Setting, SimulatedDriver


def _fit(setting: Setting, tables: frozenset[str]) -> dict[str, Fitted]:
    try:
        from pincette_nidaqmx.simulated.fitted import fit
    except ImportError as error:
        raise ConfigError(
            f"driver = 'nidaqmx': simulating it needs the package nidaqmx ({error}); install "
            "pincette with its extra: pip install 'pincette[nidaqmx]'"
        ) from error
    return fit(setting, tables)


DRIVER = SimulatedDriver(frozenset({"sensor", "output"}), _fit, OutputTraits(20.0 / 2**16, 3e-6))
"""Simulated NI-9263: 16 bit over ±10 V; the lag is assumed from the settling time."""
