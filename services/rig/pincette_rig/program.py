"""The rig program: the simulated plant behind its instruments' real bytes."""

import time

from pincette.messages import Truth
from pincette.runtime.context import Context
from pincette.runtime.priority import come_first
from pincette.runtime.rig_orders import serve_orders
from pincette.sim.bench import open_bench
from pincette.sim.script.script import script_of
from pincette_rig.config import configure


def run(context: Context) -> None:
    """Offer both instruments at the urls of the rig file, and take orders, until told to stop.

    What is true is published from the output's thread, before the write is answered; its ``seq``
    counts the ticks since the start, from 0.

    Raises
    ------
    ConfigError
        Where the rig file describes no rig that can be simulated.
    WireError
        Where a port is taken.
    """
    config = configure(context.rig)
    if not context.rig.lockstep:
        come_first(context.rig.realtime.of("rig"))
    bus = context.open_bus()

    def tell(seq: int, x_um: float, force_mN: float, voltage_V: float) -> None:
        bus.publish(Truth(seq, x_um, force_mN, voltage_V))

    try:
        script = script_of(context.rig)
        bench = open_bench(context.rig, time.monotonic, tell if config.truth else None, script)
        with bench.offer():
            serve_orders(bus, script)
            bus.announce("rig")
            context.ready(f"simulates {config.sensor_url} and {config.output_url}")
            context.stop.wait()
    finally:
        bus.close()
