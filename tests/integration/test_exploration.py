"""State space exploration of a job on the simulated rig: no sequence of actions leaves the state
table."""

import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis.stateful import run_state_machine_as_test

from tests.support.explorer import Explorer


def explore(examples: int, steps: int) -> None:
    run_state_machine_as_test(
        Explorer,
        settings=settings(
            max_examples=examples,
            stateful_step_count=steps,
            deadline=None,
            derandomize=True,
            phases=[Phase.generate],  # shrinking takes minutes, and the sequence is short enough
            database=None,
            suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
        ),
    )


def test_every_sequence_of_calls_and_faults_follows_the_state_table() -> None:
    explore(20, 30)


@pytest.mark.slow
def test_every_long_sequence_of_calls_and_faults_follows_the_state_table() -> None:
    explore(100, 50)
