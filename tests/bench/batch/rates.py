"""Plant substeps a second, law and all, in CPU time; and how two processes share them."""

import math
from time import perf_counter, process_time

from pincette_batch.cases import Case
from pincette_batch.lanes import play_lane
from pincette_batch.prepared import PreparedRig, prepare_rig
from pincette_batch.runs import play_all
from tests.bench.batch.rigs import COUNTED, RIGS, case_of, rig_of, substeps

ROUNDS = 15
SHARED = 100
"""Cases that two processes share, of which each has its own seed."""


def rates() -> dict[str, float]:
    """Substeps in a second of CPU time, by rig: the best of several rounds, all rigs in turn."""
    prepared: dict[str, tuple[PreparedRig, Case]] = {}
    for name, changes in RIGS.items():
        rig = rig_of(changes)
        prepared[name] = prepare_rig(rig), case_of(rig)
        play_lane(*prepared[name])
    best = dict.fromkeys(RIGS, 0.0)
    for _ in range(ROUNDS):
        for name, (made, case) in prepared.items():
            begin_s = process_time()
            run = play_lane(made, case)
            best[name] = max(best[name], substeps(case, run) / (process_time() - begin_s))
    return best


def two_over_one() -> float:
    """Wall time of one process over that of two, the best of several tries.

    Their start is left out by a difference of many cases and few.
    """
    rig = rig_of(RIGS[COUNTED])
    program = case_of(rig).program

    def taken_s(workers: int, cases: int) -> float:
        begin_s = perf_counter()
        play_all(
            [Case(rig, program, seed) for seed in range(cases)], keep=substeps, workers=workers
        )
        return perf_counter() - begin_s

    few, many = SHARED, 9 * SHARED
    one_s = two_s = math.inf
    for _ in range(3):
        one_s = min(one_s, taken_s(1, many) - taken_s(1, few))
        two_s = min(two_s, taken_s(2, many) - taken_s(2, few))
    return one_s / two_s
