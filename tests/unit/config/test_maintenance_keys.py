"""Serial numbers and due dates as the guide writes them into a rig file."""

import re
import tomllib
from pathlib import Path

import pytest

from pincette.config import parse_rig, read_rig
from pincette.config.reading import laid_over

ROOT = Path(__file__).parents[3]
RIGS = ROOT / "deploy/rigs"


def test_the_maintenance_entries_of_the_guide_are_accepted() -> None:
    guide = (ROOT / "docs/how-to/calibrate.md").read_text(encoding="utf-8")
    tree = tomllib.loads((RIGS / "demo.toml").read_text(encoding="utf-8"))
    for entries in re.findall(r"^```toml\n(.*?)^```", guide, re.MULTILINE | re.DOTALL):
        tree = laid_over(tree, tomllib.loads(entries))
    rig = parse_rig(tree)
    assert rig.serial_numbers == {"sensor": "1540122", "output": "A-0311"}
    assert rig.calibration.model_dump() == {
        "valid_days": 365.0,
        "valid_strokes": 50000,
        "valid_contacts": 20000,
        "valid_hours": 500.0,
    }
    assert rig.digest() == read_rig(RIGS / "demo.toml").digest()


@pytest.mark.parametrize("name", ["demo", "bring-up", "fast"])
def test_an_unknown_maintenance_key_is_refused_with_the_valid_ones(
    name: str, tmp_path: Path
) -> None:
    text = (RIGS / f"{name}.toml").read_text(encoding="utf-8")
    assert "serial_number" in text
    path = tmp_path / "rig.toml"
    path.write_text(re.sub(r"^# (\[calibration\]|valid_days)", r"\1", text, flags=re.MULTILINE))
    assert read_rig(path).calibration.valid_days == 365.0
