"""The loop in lockstep beside a bare ring of do-nothing processes: rates, tails, their ratio.

Both turn over the same hops with the same bus settings, payload sizes and serial exchanges with a
simulated rig in this process, which takes the time of every tick; blocks of one and of the other
alternate in one run, so that a slow machine slows both. A third one is the loop once more, over
mutual TLS with its access lists. Writes ``bench.json``.
"""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from pathlib import Path
from statistics import median
from time import monotonic, perf_counter, sleep

import zenoh

from pincette.bus.links import Ends, endpoint
from pincette.bus.places import program_place
from pincette.bus.zenoh_bus import ZenohBus, open_session
from pincette.config import RigFile
from pincette.control.planning.program import Guards, Program, Segment
from pincette.messages import Reset
from pincette.runtime.arming import arm, status
from pincette.runtime.fleet import Fleet
from pincette.sim.bench import open_bench
from pincette.sim.wires.wire import serve
from pincette.topics import LOOP, RESET
from tests.bench.shape import SIZES, start_key
from tests.support.certificates import folder_for
from tests.support.rigs import demo_rig, free_ports, rig_toml

TICKS = 2000
BLOCKS = 6
WARM_UP = 300
BLOCK_LIMIT_S = 60.0
WIRED = ("sensor", "actuator")
GUARDS = Guards(2.0, 3, 40.0, 0.3, 5, 1.5, 2.9, 1.0)


class Stopwatch:
    """An instrument that notes when it is asked, and hands on to the real one or answers blank."""

    def __init__(self, answer: Callable[[bytes], bytes | None]) -> None:
        self._answer = answer
        self.asked_s: list[float] = []

    def answer(self, line: bytes) -> bytes | None:
        """Note the time of a measurement; it begins a tick."""
        if line.startswith(b"MS"):
            self.asked_s.append(perf_counter())
        return self._answer(line)

    def idle(self) -> None:
        """Nothing to look after."""

    def ticks(self) -> list[float]:
        """Lengths of the ticks since the last call, in seconds, the warm-up left out."""
        times, self.asked_s = self.asked_s, []
        return [later - sooner for sooner, later in pairwise(times)][WARM_UP:]


Turn = tuple[Callable[[int], None], Stopwatch]
"""Runs a number of ticks, and the watch that times them."""


def blank(line: bytes) -> bytes:
    """What an instrument without a plant says."""
    return b"MS,01,+0030.02" if line.startswith(b"MS") else b">"


def bench_rig() -> RigFile:
    """The demo rig in lockstep on ports of its own, without the simulation's own log."""
    return demo_rig({"rig": {"name": "bench"}, "simulation": {"truth": False}}, time="lockstep")


def program(ticks: int, period_s: float) -> Program:
    """Rest for a number of ticks."""
    return Program((Segment("rest", "free", ticks * period_s, x_to_um=0.0),), GUARDS, 2.17)


@contextmanager
def real_loop(folder: Path, rig: RigFile, watch: Stopwatch) -> Generator[Callable[[int], None]]:
    """The four services of the loop; yields a function that runs a number of ticks."""
    path = folder / "bench.toml"
    path.write_text(rig_toml(rig), encoding="utf-8")
    fleet = Fleet(rig, path, folder, lambda _name, _line: None)
    bus: ZenohBus | None = None
    try:
        fleet.start(["router"])
        fleet.start(LOOP)
        ends = program_place(rig, "supervisor", lockstep=True)
        bus = ZenohBus(ends, rig.rig.name, "bench")
        bus.ask(RESET, Reset(acknowledge=True))
        joined = bus
        epoch = 0

        def run(ticks: int) -> None:
            nonlocal epoch
            epoch += 1
            wish = program(ticks, rig.rig.period_s)
            arm(joined, wish, epoch=epoch, digest=rig.digest())
            wait(lambda: len(watch.asked_s) >= ticks, "loop")
            wait(lambda: status(joined, "actuator").detail.startswith("idle"), "loop")

        yield run
    finally:
        if bus is not None:
            bus.close()
        fleet.down()


@contextmanager
def simulated_loop(
    folder: Path, rig: RigFile
) -> Generator[tuple[Callable[[int], None], Stopwatch]]:
    """The loop with its simulated instruments, and the watch that times its ticks."""
    simulated = open_bench(rig, perf_counter)
    watch = Stopwatch(simulated.sensor.answer)
    folder.mkdir(exist_ok=True)
    with (
        serve(rig.sensor.url, watch),
        serve(rig.output.url, simulated.output),
        real_loop(folder, rig, watch) as run,
    ):
        yield run, watch


@contextmanager
def bare_ring(
    port: int, wires: dict[str, str], watch: Stopwatch
) -> Generator[Callable[[int], None]]:
    """Four do-nothing processes; yields a function that runs a number of ticks."""
    processes = [
        subprocess.Popen(
            [sys.executable, "-m", "tests.bench.ring", role, str(port), wires.get(role, "-")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        for role in LOOP
    ]
    session: zenoh.Session | None = None
    try:
        for process in processes:
            if process.stdout is None or process.stdout.readline() != b"ready\n":
                raise RuntimeError("a process of the bare ring did not start")
        first = endpoint("127.0.0.1", port, LOOP[0])
        session = open_session(Ends("client", connect=(first,)), "bench")
        sleep(1.0)
        joined = session

        def run(ticks: int) -> None:
            joined.put(start_key(), str(ticks).encode())
            wait(lambda: len(watch.asked_s) >= ticks, "bare ring")

        yield run
    finally:
        if session is not None:
            session.close()
        for process in processes:
            process.terminate()
            process.communicate()


def wait(done: Callable[[], bool], what: str) -> None:
    """Wait for the end of a block."""
    deadline = monotonic() + BLOCK_LIMIT_S
    while not done():
        if monotonic() > deadline:
            raise TimeoutError(f"the {what} did not end within {BLOCK_LIMIT_S:g} s")
        sleep(0.01)


def quantile(values: list[float], share: float) -> float:
    """Value below which a share of the values lies."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def stolen_s() -> float:
    """Time that the machine's host took away since it started, in CPU seconds."""
    with Path("/proc/stat").open(encoding="ascii") as stream:
        return int(stream.readline().split()[8]) / os.sysconf("SC_CLK_TCK")


def rate(blocks: list[list[float]]) -> float:
    """Ticks per second, of the block in the middle."""
    return median(len(block) / sum(block) for block in blocks)


def tail_ms(blocks: list[list[float]]) -> float:
    """Length that one tick in a hundred exceeds, of the block in the middle."""
    return 1e3 * median(quantile(block, 0.99) for block in blocks)


def middle_ms(blocks: list[list[float]]) -> float:
    """Length that half of the ticks exceed, of the block in the middle."""
    return 1e3 * median(median(block) for block in blocks)


def summarize(
    loop: list[list[float]], mtls: list[list[float]], ring: list[list[float]], period_s: float
) -> dict[str, float]:
    """Ratios over all blocks, and the rates behind them."""
    return {
        "loop_over_bare": rate(loop) / rate(ring),
        "p99_over_bare": tail_ms(loop) / tail_ms(ring),
        "mtls_over_plain": rate(mtls) / rate(loop),
        "mtls_p99_over_plain": tail_ms(mtls) / tail_ms(loop),
        "lockstep_over_realtime": rate(loop) * period_s,
        "bare_over_realtime": rate(ring) * period_s,
        "loop_per_s": rate(loop),
        "mtls_per_s": rate(mtls),
        "bare_per_s": rate(ring),
        "loop_p50_ms": middle_ms(loop),
        "mtls_p50_ms": middle_ms(mtls),
        "bare_p50_ms": middle_ms(ring),
        "loop_p99_ms": tail_ms(loop),
        "mtls_p99_ms": tail_ms(mtls),
        "bare_p99_ms": tail_ms(ring),
    }


def main() -> None:
    """Measure, print, write."""
    stolen = stolen_s()
    ring_watch = Stopwatch(blank)
    port = free_ports(8)
    wires = {name: f"socket://127.0.0.1:{port + 6 + n}" for n, name in enumerate(WIRED)}
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        stack.enter_context(serve(wires["sensor"], ring_watch))
        stack.enter_context(serve(wires["actuator"], Stopwatch(blank)))
        rig, other = bench_rig(), bench_rig()
        secured = other.secured(folder_for(folder / "pki", other.rig.name).path)
        turns = {
            "loop": stack.enter_context(simulated_loop(folder / "plain", rig)),
            "loop over mutual TLS": stack.enter_context(simulated_loop(folder / "mtls", secured)),
            "bare ring": (stack.enter_context(bare_ring(port, wires, ring_watch)), ring_watch),
        }
        blocks: dict[str, list[list[float]]] = {name: [] for name in turns}
        for block in range(BLOCKS):
            for name, (run, watch) in turns.items():
                run(TICKS)
                blocks[name].append(watch.ticks())
            rates = (f"{name} {rate(done[-1:]):.0f} ticks/s" for name, done in blocks.items())
            print(f"block {block + 1} of {BLOCKS}: {', '.join(rates)}")
    plain, mtls, bare = blocks.values()
    summary = summarize(plain, mtls, bare, rig.rig.period_s)
    report = {
        "summary": summary,
        "ticks_per_block": TICKS,
        "blocks": BLOCKS,
        "payload_bytes": SIZES,
        "stolen_s": stolen_s() - stolen,
    }
    Path("bench.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    print(
        f"loop {summary['loop_per_s']:.0f} ticks/s, bare ring {summary['bare_per_s']:.0f} ticks/s:"
        f" ratio {summary['loop_over_bare']:.2f}; p99 ratio {summary['p99_over_bare']:.2f}; "
        f"{summary['lockstep_over_realtime']:.1f} times real time at T = "
        f"{1e3 * rig.rig.period_s:g} ms (bare ring {summary['bare_over_realtime']:.1f}); "
        f"mutual TLS {summary['mtls_per_s']:.0f} ticks/s: mtls_over_plain "
        f"{summary['mtls_over_plain']:.2f}, p99 ratio {summary['mtls_p99_over_plain']:.2f}; "
        "bench.json written"
    )


if __name__ == "__main__":
    main()
