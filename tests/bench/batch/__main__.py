"""What a batch costs. Adds its figures to ``bench.json``; run by ``python -m tests.bench.batch``.

Rates are of one core and count CPU time; the gain by two processes, and whole errands, count wall
time and want both cores free.
"""

import os

from tests.bench.batch.errands import times_s
from tests.bench.batch.rates import rates, two_over_one
from tests.bench.batch.rigs import COUNTED
from tests.bench.loop.report import keep


def main() -> None:
    """Measure, print, keep."""
    found = rates()
    print(f"{'plant':<26} {'million substeps/s':>20} {'ns a substep':>14}")
    for name, rate in found.items():
        print(f"{name:<26} {1e-6 * rate:20.1f} {1e9 / rate:14.1f}", flush=True)
    gain = two_over_one()
    print(f"two processes over one: {gain:.2f} (cores: {os.cpu_count()})", flush=True)
    spent_s = times_s()
    for name, errand_s in spent_s.items():
        print(f"{name:<26} {errand_s:20.2f} s")
    keep(
        {
            "batch_substeps_per_s": found[COUNTED],
            "batch_two_over_one": gain,
            "batch_sweep_s": spent_s["sweep"],
            "batch_tuning_s": spent_s["tuning"],
        },
        {"batch": {"substeps_per_s": found, "errands_s": spent_s}},
    )


if __name__ == "__main__":
    main()
