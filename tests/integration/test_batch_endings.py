"""A lane that a guard or a limit ends has the composed loop's bits until there, and its reason."""

import numpy as np
import pytest

from pincette_batch.composed import play_composed
from pincette_batch.followed import program_objection, rig_objection
from pincette_batch.kernel.lane import Ending
from pincette_batch.lanes import play_lane
from pincette_batch.prepared import prepare_rig
from tests.support.batches import TROUBLES, drawn_case, same

CASES = 5 * len(TROUBLES)
WORDS = {
    Ending.OVERFORCE: ("overforce",),
    Ending.NO_CONTACT: ("no_contact",),
    Ending.LOST: ("lost",),
    Ending.NO_LINE: ("wrong_stiffness",),
    Ending.LIMIT: ("force:", "position:", "following_error:"),
}
"""How the controller, or the actuator that tripped, says it."""
MET = {*WORDS, Ending.DONE, Ending.BLIND, Ending.CONTACT}


@pytest.mark.parametrize("seed", range(CASES))
def test_until_its_end_a_lane_is_the_composed_loop(seed: int) -> None:
    trouble, case = drawn_case(seed)
    assert rig_objection(case.rig) == program_objection(case.program) == ""
    run, composed = play_lane(prepare_rig(case.rig), case), play_composed(case)
    if run.ending is Ending.DONE:
        same(run, composed)
        return
    assert trouble != "none"
    if run.ending is Ending.CONTACT:
        # A lane does not know the uncertainty: what it only suspects the composed loop decides.
        assert composed.ending in (Ending.DONE, Ending.OTHERWISE)
        return
    assert composed.ending is Ending.OTHERWISE
    ticks = run.columns.shape[1]
    assert np.array_equal(run.columns, composed.columns[:, :ticks])
    assert composed.outcome.startswith(WORDS.get(run.ending, ("",))), run.outcome


def test_all_endings_are_met() -> None:
    """Those above, whatever becomes of the troubles when a rig or a plan changes."""
    cases = [drawn_case(seed)[1] for seed in range(CASES)]
    assert {play_lane(prepare_rig(case.rig), case).ending for case in cases} >= MET
