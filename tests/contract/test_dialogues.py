"""Each driver sends exactly the bytes that are documented in tests/data/dialogues."""

from pathlib import Path

import pytest

from pincette.instruments.line.recording import read_recording
from tests.support.dialogues import DIALOGUES, FOLDER, Said, record, replay

# fmt: off
SAID: dict[str, list[Said]] = {
    "keyence_lkg": [
        0.0, 30.02, -12.57, 9999.99, "out_of_range", "out_of_range", "invalid", "silent", 1.0,
    ],
    "icpdas_i7024": [
        None, 0.0, None, 1.234, None, -10.0, "misused", -10.0, "silent", None,
        "tripped", 0.0, None, None,
    ],
    "srs_dc205": [
        0.0, None, 1.5, None, -0.0004, None, 10.0, "misused", 10.0, "silent", "invalid", "refused",
    ],
}
# fmt: on


@pytest.mark.parametrize("name", DIALOGUES)
def test_the_driver_sends_the_documented_dialogue(name: str, tmp_path: Path) -> None:
    record(name, tmp_path / "anew.txt")
    anew = read_recording(tmp_path / "anew.txt")
    kept = read_recording(FOLDER / f"{name}.txt")
    assert [entry.request for entry in anew] == [entry.request for entry in kept]
    assert len(kept) >= 10


@pytest.mark.parametrize("name", DIALOGUES)
def test_the_recording_replays_the_answers_of_the_instrument(name: str, tmp_path: Path) -> None:
    live = record(name, tmp_path / "anew.txt")
    assert replay(name, FOLDER / f"{name}.txt") == live
    assert replay(name, tmp_path / "anew.txt") == live
    assert live == SAID[name]


def test_every_recorded_dialogue_is_tested() -> None:
    assert {path.stem for path in FOLDER.iterdir()} == set(DIALOGUES)
