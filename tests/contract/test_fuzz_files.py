"""Whatever a rig file or a received model contains, it is accepted, or refused with a message and
no traceback.

Seeded.
"""

import json
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest

from pincette.cli.main import main
from pincette.config import ConfigError, calibrated, parse_calibration, parse_rig_json, read_rig
from pincette.config.calibration import CALIBRATED, EXPECTED
from pincette.config.toml_file import MOST_BYTES
from pincette.core.service import programs
from pincette.engine.process import Options, run_program
from tests.support.rigs import DEMO, demo_rig, rig_toml

SEED = 20135
RIG_FILES, MODELS = 1_500, 1_500
TREE = json.loads(demo_rig().model_dump_json())
TOML = rig_toml(demo_rig())
WORDS = (
    "nan", "inf", "-inf", "1e309", "-1", "0", "9" * 5000, "9223372036854775808", "true", '""',
    '"x"',
    "[]", "{}", "[[[]]]", "1979-05-27", "0x7f", "'''\na\n'''", '"\\u0000"', '"\\u202e"', "1e-320",
    '"socket://"', '"socket://[::1"', '"grpc://x:y"', '"' + "x" * 5000 + '"', "1_000_000_000_000",
)  # fmt: skip
BROKEN: dict[str, tuple[bytes, str]] = {
    "no UTF-8": (b"\xff\xfe[\x00r\x00", "UTF-16"),
    "broken UTF-8": (b'[rig]\nname = "\xc3\x28"\n', "not UTF-8"),
    "lists in lists": (b"a = " + b"[" * 20_000, "not TOML"),
    "maps in maps": (b"a = " + b"{b=" * 20_000, "not TOML"),
    "tables in tables": (b"[" + b"a." * 20_000 + b"a]\n", "rig file"),
    "endless digits": (b"[rig]\nperiod_s = " + b"9" * 10_000, "not TOML"),
    "NUL": (b"[rig]\nname = 'a\x00'\n", "not TOML"),
    "empty": (b"", "rig"),
    "too large": (b"# " + b"x" * MOST_BYTES, "larger than"),
    "the same table twice": (b"[rig]\n[rig]\n", "not TOML"),
    "a base that cannot be named": (b'base = "\\u0000"\n', "no file can have this name"),
    "a base that is a folder": (b'base = "."\n', "directory"),
    "a base of its own": (b'base = "broken.toml"\n', "has a base itself"),
    "a base without end": (b'base = "/dev/zero"\n', "larger than"),
    "odd keys": (b'["\\u001b[2J"]\n"a\\nb" = 1\n', "is not a known name"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_rig_file_is_refused_with_a_readable_message(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content, words = BROKEN[case]
    path = tmp_path / "broken.toml"
    path.write_bytes(content)
    with pytest.raises(ConfigError) as caught:
        read_rig(path)
    message = str(caught.value)
    assert words in message
    assert len(message) < 20_000
    assert all(line.isprintable() for line in message.splitlines())
    assert main(["doctor", "--topics", "--rig", str(path)]) == 1
    printed = capsys.readouterr()
    assert words in printed.err
    assert "Traceback" not in printed.err + printed.out


@pytest.mark.parametrize("name", programs())
def test_no_program_starts_on_a_broken_rig_file(
    name: str, tmp_path: Path, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "broken.toml"
    path.write_text('[rig]\nname = "r"\nperiod_s = "fast"\n', encoding="utf-8")
    assert run_program(name, path, Options(tmp_path)) == 2
    (stated,) = caplog.messages
    assert "rig.period_s = 'fast'" in stated
    written = capfd.readouterr()
    assert "Traceback" not in caplog.text + written.out + written.err


def test_doctor_names_what_is_broken(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "broken.toml"
    path.write_text('[rig]\nname = "r"\nperiod_s = "fast"\n', encoding="utf-8")
    assert main(["doctor", "--rig", str(path), "--data", str(tmp_path)]) == 1
    printed = capsys.readouterr()
    assert "rig.period_s = 'fast'" in printed.out.replace("\n", "")
    assert "Traceback" not in printed.err + printed.out


def refusal(read: Callable[[], object]) -> str:
    """Return the message with which reading is refused, each line fit for a terminal; empty if it
    is accepted."""
    message = ""
    try:
        read()
    except ConfigError as error:
        message = str(error)
    assert all(line.isprintable() for line in message.splitlines())
    return message


def spoilt(chance: random.Random) -> bytes:
    """Return a rig file with some values exchanged, some lines reordered, some bytes changed."""
    lines = TOML.splitlines()
    for _ in range(chance.randrange(1, 4)):
        place = chance.randrange(len(lines))
        name, equals, _ = lines[place].partition(" = ")
        kind = chance.randrange(6)
        if equals and kind < 4:
            lines[place] = f"{name} = {chance.choice(WORDS)}"
        elif kind == 4:
            del lines[place]
        else:
            lines.insert(place, chance.choice(lines))
    content = bytearray("\n".join(lines).encode())
    for _ in range(chance.choice((0, 0, 0, 2))):
        content[chance.randrange(len(content))] = chance.randrange(256)
    return bytes(content)


def test_corrupted_rig_files_are_read_or_refused(tmp_path: Path) -> None:
    print(f"seed {SEED}")
    chance, path, read = random.Random(SEED), tmp_path / "rig.toml", 0
    for _ in range(RIG_FILES):
        path.write_bytes(spoilt(chance))
        read += not refusal(lambda: len(read_rig(path).digest()))
    assert 0.02 < read / RIG_FILES < 0.9


VALUES: tuple[Any, ...] = (
    1.0, -1.0, 0.0, float("nan"), float("inf"), 1e308, 10**400, True, None, "x", [], {}, [[1]],
    {"coefficients": []}, TREE["model"]["free_response"], {"free_response": 1}, [1.0] * 50,
)  # fmt: skip
"""Values that may replace any quantity."""


def test_received_models_are_accepted_or_refused() -> None:
    print(f"seed {SEED}")
    chance, rig, read = random.Random(SEED), read_rig(DEMO), 0
    for _ in range(MODELS):
        names = chance.sample((*CALIBRATED, *EXPECTED, "model.x", "rig.name", "x"), 2)
        tree: Any = {"values": {name: chance.choice(VALUES) for name in names}, "sources": {}}
        if chance.random() < 0.2:
            tree = {**tree, chance.choice(("values", "sources", "x")): chance.choice(VALUES)}
        text = json.dumps(tree)
        if chance.random() < 0.1:
            text = text[: chance.randrange(len(text))] or "["
        read += not refusal(lambda: calibrated(rig, parse_calibration(text)))  # noqa: B023  at once
    assert 0 < read < MODELS


@pytest.mark.parametrize("text", ["[" * 50_000, "", "null", "1", '{"rig": 1}', "\x00", "NaN", "{}"])
def test_an_invalid_received_rig_file_is_refused(text: str) -> None:
    with pytest.raises(ConfigError):
        parse_rig_json(text)
    if text:
        with pytest.raises(ConfigError):
            parse_calibration(text if text != "{}" else "[]")


def test_changed_rig_files_in_json_are_read_or_refused() -> None:
    chance = random.Random(SEED)
    for _ in range(300):
        tree = json.loads(json.dumps(TREE))
        table = cast("dict[str, Any]", tree[chance.choice(list(tree))] or {})
        if table:
            table[chance.choice(list(table))] = chance.choice(VALUES)
        refusal(lambda: parse_rig_json(json.dumps(tree)))  # noqa: B023  called at once
