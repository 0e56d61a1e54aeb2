"""Measure the loop and the rings in alternating blocks, so that a slow machine slows all of them.

All pass ticks over the same hops with the same bus settings, payload sizes and serial exchanges;
the instruments are in this process and measure the time of every tick. Writes ``bench.json`` and
``bench.png``.
"""

import argparse
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from tests.bench.loop.composed import composed_over_realtime
from tests.bench.loop.contestant import Contestant
from tests.bench.loop.figures import cpu_us, own, rate, ratios, tail_ms
from tests.bench.loop.machine import stolen_s
from tests.bench.loop.packages import PACKAGES, folder_of_packages
from tests.bench.loop.plot import draw
from tests.bench.loop.real import bench_rig, real_loop
from tests.bench.loop.report import keep
from tests.bench.loop.rings import package_ring, socket_ring, zenoh_ring
from tests.bench.loop.watch import WARM_UP
from tests.bench.shape import SIZES
from tests.support.certificates import folder_for

TICKS = 2000
LEAST_TICKS = WARM_UP + 2
"""Lowest number of ticks in a measurement, which begins and ends with a counted tick."""
BLOCKS = 6
PLOT = Path("bench.png")


def main(words: Sequence[str] | None = None) -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.loop", description=__doc__)
    parser.add_argument("--ticks", type=int, default=TICKS, help="of a block; %(default)s")
    parser.add_argument("--blocks", type=int, default=BLOCKS, help="%(default)s")
    given = parser.parse_args(words)
    if given.ticks < LEAST_TICKS:
        parser.error(
            f"--ticks = {given.ticks}: the limit is {LEAST_TICKS}, since the first {WARM_UP} ticks "
            f"of a block are its warm-up and are not counted; give --ticks {TICKS}, or at least "
            f"{LEAST_TICKS}"
        )
    if given.blocks < 1:
        parser.error(f"--blocks = {given.blocks}: the limit is 1; give --blocks {BLOCKS}")
    stolen = stolen_s()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        rig, other = bench_rig(), bench_rig()
        secured = other.secured(folder_for(folder / "pki", other.rig.name).path)
        loop = stack.enter_context(real_loop("loop", folder / "plain", rig))
        third = bench_rig()
        simulated = stack.enter_context(real_loop("simulated", folder / "rig", third, plant=True))
        mtls = stack.enter_context(real_loop("mtls", folder / "mtls", secured))
        bare = stack.enter_context(zenoh_ring("bare"))
        routed = stack.enter_context(zenoh_ring("routed_bare", "routed"))
        whole = stack.enter_context(zenoh_ring("whole", "whole"))
        coded = stack.enter_context(zenoh_ring("coded", "coded"))
        sockets = stack.enter_context(socket_ring("sockets"))
        packages = folder_of_packages()
        others = [stack.enter_context(package_ring(name, packages)) for name in PACKAGES]
        contestants = (loop, simulated, mtls, bare, whole, coded, routed, sockets, *others)
        for block in range(1, given.blocks + 1):
            for contestant in contestants:
                contestant.measure(given.ticks)
            rates = ", ".join(f"{one.name} {one.blocks[-1].per_s:.0f}" for one in contestants)
            print(f"block {block} of {given.blocks}, ticks/s: {rates}", flush=True)
    summary = ratios(loop, bare) | {
        "lockstep_over_realtime": rate(simulated.blocks) * rig.rig.period_s,
        "bare_over_realtime": rate(bare.blocks) * rig.rig.period_s,
        "mtls_over_plain": rate(mtls.blocks) / rate(loop.blocks),
        "mtls_p99_over_plain": tail_ms(mtls.blocks, 0.99) / tail_ms(loop.blocks, 0.99),
        "loop_over_whole": rate(loop.blocks) / rate(whole.blocks),
        "loop_over_coded": rate(loop.blocks) / rate(coded.blocks),
        "coded_over_bare": rate(coded.blocks) / rate(bare.blocks),
        "whole_over_bare": rate(whole.blocks) / rate(bare.blocks),
        "bare_over_sockets": rate(bare.blocks) / rate(sockets.blocks),
        "routed_over_bare": rate(routed.blocks) / rate(bare.blocks),
        "composed_over_realtime": composed_over_realtime(rig),
    }
    for other in others:
        summary[f"loop_over_{other.name}"] = rate(loop.blocks) / rate(other.blocks)
        summary[f"bare_over_{other.name}"] = rate(bare.blocks) / rate(other.blocks)
    for contestant in contestants:
        summary |= own(contestant)
    details = {
        "ticks_per_block": given.ticks,
        "blocks": given.blocks,
        "payload_bytes": SIZES,
        "cpu_us_per_tick": {one.name: cpu_us(one.blocks) for one in contestants},
        "stolen_s": stolen_s() - stolen,
        "stolen_s_by_block": {one.name: [b.stolen_s for b in one.blocks] for one in contestants},
    }
    keep(summary, details)
    draw(PLOT, contestants)
    _tell(contestants, summary, 1e3 * rig.rig.period_s)


def _tell(contestants: tuple[Contestant, ...], summary: dict[str, float], period_ms: float) -> None:
    print(f"{'':<12}{'ticks/s':>9}{'p50 ms':>9}{'p99 ms':>9}{'p99.9 ms':>9}{'CPU µs':>9}")
    for one in contestants:
        columns = ("per_s", "p50_ms", "p99_ms", "p999_ms", "cpu_us")
        figures = [summary[f"{one.name}_{column}"] for column in columns]
        rate_per_s, *tails, spent_us = figures
        shown = "".join(f"{tail:9.3f}" for tail in tails)
        print(f"{one.name:<12}{rate_per_s:9.0f}{shown}{spent_us:9.0f}")
    print(
        f"loop over bare ring {summary['loop_over_bare']:.2f}, p99 {summary['p99_over_bare']:.2f}, "
        f"own {summary['own_us_per_hop']:.0f} µs a hop; at T = {period_ms:g} ms "
        f"{summary['lockstep_over_realtime']:.1f} times real time (bare ring "
        f"{summary['bare_over_realtime']:.1f}, composed {summary['composed_over_realtime']:.0f}); "
        "bench.json and bench.png written"
    )


if __name__ == "__main__":
    main()
