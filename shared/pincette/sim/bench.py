"""The bench: the plant with both simulated instruments, as a rig file describes them."""

from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from pincette.config import ConfigError, RigFile, Simulation
from pincette.sim.instruments.fitting import (
    TABLES,
    Fitted,
    Setting,
    resolved,
    simulated_driver,
    simulated_in,
)
from pincette.sim.instruments.protocol import Instrument
from pincette.sim.rig.rig import SimulatedRig, TruthSink
from pincette.sim.script.script import Script
from pincette.sim.wires.wire import serve


@dataclass(frozen=True, slots=True)
class Bench:
    """A simulated rig and its two instruments."""

    rig: SimulatedRig
    fitted: dict[str, Fitted]
    """By table of the rig file: ``sensor`` and ``output``."""

    @property
    def sensor(self) -> Instrument:
        """The position sensor."""
        return self.fitted["sensor"].instrument

    @property
    def output(self) -> Instrument:
        """The voltage output."""
        return self.fitted["output"].instrument

    @contextmanager
    def offer(self) -> Generator[dict[str, str]]:
        """Offer both instruments at their urls; yields where each one is; raises WireError."""
        with ExitStack() as ports:
            at: dict[str, str] = {}
            servers: dict[int, str] = {}
            for table, fitted in self.fitted.items():
                if fitted.server is None or fitted.open_server is None:
                    wire = serve(
                        fitted.url,
                        fitted.instrument,
                        fitted.baud,
                        fitted.terminator or b"",
                        afterwards=self.rig.pass_time,
                    )
                    at[table] = ports.enter_context(wire).url
                    continue
                shared = id(fitted.server)
                if shared not in servers:
                    server = fitted.open_server(fitted.url, fitted.server)
                    servers[shared] = ports.enter_context(server).url
                at[table] = servers[shared]
            yield at


def open_bench(
    rig_file: RigFile,
    clock: Callable[[], float],
    truth: TruthSink | None = None,
    script: Script | None = None,
    pace: Callable[[float], None] | None = None,
) -> Bench:
    """Set up the instruments that the drivers of a rig file expect to meet; raises ConfigError."""
    simulation = rig_file.simulation
    if simulation is None:
        raise ConfigError("[simulation] is missing: this rig file describes a real rig")
    tables_of: dict[str, set[str]] = {}
    for table in TABLES:
        name = (rig_file.sensor if table == "sensor" else rig_file.output).driver
        driver = simulated_driver(name)
        if driver is None or table not in driver.tables:
            known = ", ".join(map(repr, simulated_in(table)))
            raise ConfigError(f"{table}.driver = {name!r}: only {known} are simulated")
        tables_of.setdefault(name, set()).add(table)
    plant = resolved(simulation, rig_file.output.driver)
    try:
        rig = SimulatedRig(plant, rig_file.rig.period_s, rig_file.lockstep, clock, truth)
    except ValueError as error:
        raise ConfigError(f"[simulation] is no possible rig: {error}") from error
    if script is not None:
        script.operate(rig)
    setting = _setting(rig_file, simulation, rig, script, pace)
    fitted: dict[str, Fitted] = {}
    for name, tables in tables_of.items():
        if (driver := simulated_driver(name)) is not None:
            fitted |= driver.fit(setting, frozenset(tables))
    return Bench(rig, fitted)


def _setting(
    rig_file: RigFile,
    simulation: Simulation,
    rig: SimulatedRig,
    script: Script | None,
    pace: Callable[[float], None] | None,
) -> Setting:
    """The rig as the instruments meet it, at its pace, through the script where there is one."""

    def paced_um() -> float:
        if pace is not None:
            pace(rig.now_s())
        return rig.measure_um()

    measure_um = rig.measure_um if pace is None else paced_um
    if script is None:
        return Setting(rig_file, simulation, rig, measure_um, rig.put_out, lambda _table, one: one)
    put_out = script.put_out(rig.put_out)
    return Setting(rig_file, simulation, rig, script.measure(measure_um), put_out, script.link)
