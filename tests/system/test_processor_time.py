"""Commands that are typed often take little processor time."""

import pytest

from pincette.cli import Exit
from tests.support.commands import processor_ratio
from tests.support.running import RunningRig

RATIO, DOCTOR, TYPO = 48.0, 80.0, 24.0
"""Upper bounds in multiples of the processor time of an empty Python program, which is about 11 ms:
0.53 s, 0.9 s and 0.26 s. Doctor takes 0.5 s, more where it waits for programs."""


@pytest.mark.parametrize(
    ("words", "most"), [("doctor --rig", DOCTOR), ("rigs --url", RATIO), ("job list --url", RATIO)]
)
def test_commands_need_little_processor_time(paced: RunningRig, words: str, most: float) -> None:
    # On a busy machine doctor may find that the rig is not ready.
    status = None if words.startswith("doctor") else Exit.DONE
    place = str(paced.path) if words.endswith("--rig") else paced.rig.supervisor.url
    assert processor_ratio(*words.split(), place, status=status) < most


@pytest.mark.parametrize(
    ("words", "most"), [("gripp", TYPO), ("job gripp", RATIO), ("doctor --topics", RATIO)]
)
def test_commands_without_requests_need_little_processor_time(words: str, most: float) -> None:
    status = Exit.USAGE if words.endswith("gripp") else Exit.DONE
    assert processor_ratio(*words.split(), status=status) < most
