"""Bench: the plant with its simulated instruments, set up from a rig file."""

from collections.abc import Callable, Generator, Mapping
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
from pincette.sim.rig.pair_rig import ArmOfPair, SimulatedPair
from pincette.sim.rig.rig import SimulatedRig, TruthSink
from pincette.sim.script.script import Script
from pincette.sim.wires.wire import serve

PREFIXES = ("", "second_")
"""Prefixes of each arm's tables in names of instruments and in a script."""


@dataclass(frozen=True, slots=True)
class Bench:
    """A simulated rig and its instruments."""

    rig: SimulatedRig | SimulatedPair
    fitted: dict[str, Fitted]
    """Instruments by table of the rig file: ``sensor``, ``output``, ``second_sensor``,
    ``second_output``."""

    @property
    def sensor(self) -> Instrument:
        """Position sensor; with two arms, that of the first arm."""
        return self.fitted["sensor"].instrument

    @property
    def output(self) -> Instrument:
        """Voltage output; with two arms, that of the first arm."""
        return self.fitted["output"].instrument

    @contextmanager
    def offer(self) -> Generator[dict[str, str]]:
        """Open a port for each instrument; yields the url of each; raises WireError."""
        with ExitStack() as ports:
            at: dict[str, str] = {}
            servers: dict[int, str] = {}
            for table, fitted in self.fitted.items():
                if fitted.server is None or fitted.open_server is None:
                    if (shared := id(fitted.instrument)) in servers:
                        at[table] = servers[shared]
                        continue
                    wire = serve(
                        fitted.url,
                        fitted.instrument,
                        fitted.baud,
                        fitted.terminator or b"",
                        afterwards=self.rig.pass_time,
                    )
                    at[table] = servers[shared] = ports.enter_context(wire).url
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
    """Set up the instruments that the drivers of a rig file expect; raises ConfigError."""
    simulation = rig_file.simulation
    if simulation is None:
        raise ConfigError("[simulation] is missing: this rig file describes a real rig")
    for prefix, arm in zip(PREFIXES, rig_file.arms, strict=False):
        _require_simulated(arm, prefix.replace("_", "."))
    try:
        rig, arms = _simulated(rig_file, simulation, clock, truth)
    except ConfigError:
        raise
    except ValueError as error:
        raise ConfigError(f"[simulation] does not describe a possible rig: {error}") from error
    if script is not None:
        script.operate(rig)
    fitted: dict[str, Fitted] = {}
    for prefix, arm, of_arm in zip(PREFIXES, rig_file.arms, arms, strict=False):
        of_simulation = arm.simulation or simulation
        beside = dict(fitted)
        setting = _setting(arm, of_simulation, of_arm, script, prefix, pace, beside)
        for name, tables in _tables_of(arm).items():
            if (driver := simulated_driver(name)) is not None:
                found = driver.fit(setting, frozenset(tables))
                fitted |= {f"{prefix}{table}": one for table, one in found.items()}
                fitted |= _shared(beside, found)
    return Bench(rig, fitted)


def _shared(beside: Mapping[str, Fitted], found: Mapping[str, Fitted]) -> dict[str, Fitted]:
    """Return the first arm's instruments that the second arm shares, with effects of the script."""
    modules = {id(one.module): one for one in found.values() if one.module is not None}
    return {
        table: modules[id(one.module)]
        for table, one in beside.items()
        if one.module is not None and id(one.module) in modules
    }


def _tables_of(arm: RigFile) -> dict[str, set[str]]:
    """Return the tables of the rig file for each driver that they name."""
    tables_of: dict[str, set[str]] = {}
    for table in TABLES:
        name = (arm.sensor if table == "sensor" else arm.output).driver
        tables_of.setdefault(name, set()).add(table)
    return tables_of


def _require_simulated(arm: RigFile, prefix: str) -> None:
    for name, tables in _tables_of(arm).items():
        driver = simulated_driver(name)
        for table in sorted(tables):
            if driver is None or table not in driver.tables:
                known = ", ".join(map(repr, simulated_in(table)))
                raise ConfigError(f"{prefix}{table}.driver = {name!r}: only {known} are simulated")


def _simulated(
    rig_file: RigFile,
    simulation: Simulation,
    clock: Callable[[], float],
    truth: TruthSink | None,
) -> tuple[SimulatedRig | SimulatedPair, tuple[SimulatedRig | ArmOfPair, ...]]:
    """Return the plant, and the rig or the arms that the instruments use; raises ValueError."""
    period_s, lockstep = rig_file.rig.period_s, rig_file.lockstep
    if rig_file.second is None:
        plant = resolved(simulation, rig_file.output.driver)
        rig = SimulatedRig(plant, period_s, lockstep, clock, truth)
        return rig, (rig,)
    one, two = (resolved(arm.simulation or simulation, arm.output.driver) for arm in rig_file.arms)
    pair = SimulatedPair(simulation, (one, two), period_s, lockstep, clock, truth)
    return pair, (ArmOfPair(pair, 0), ArmOfPair(pair, 1))


def _setting(
    arm: RigFile,
    simulation: Simulation,
    rig: SimulatedRig | ArmOfPair,
    script: Script | None,
    prefix: str,
    pace: Callable[[float], None] | None,
    beside: Mapping[str, Fitted],
) -> Setting:
    """Return the environment of an arm's instruments, with the script's effects if there is one."""

    def paced_um() -> float:
        if pace is not None:
            pace(rig.now_s())
        return rig.measure_um()

    # The first arm is measured first in each tick, so only its measurement waits for the pace.
    measure_um = rig.measure_um if pace is None or prefix else paced_um
    if script is None:
        return Setting(
            arm, simulation, rig, measure_um, rig.put_out, lambda _table, one: one, beside
        )
    return Setting(
        arm,
        simulation,
        rig,
        script.measure(measure_um, f"{prefix}sensor"),
        script.put_out(rig.put_out, f"{prefix}output"),
        lambda table, one: script.link(f"{prefix}{table}", one),
        beside,
        script.put_out_wave(rig.put_out_wave, f"{prefix}output"),
    )
