"""The list of packages, the entry points and the folders say the same."""

from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
SERVICES = sorted(path.name for path in (ROOT / "services").iterdir() if path.is_dir())
OUTSIDE_THE_LOOP = ("recorder", "rig", "supervisor")


def packages() -> list[str]:
    return ["shared/pincette", *(f"services/{name}/pincette_{name}" for name in SERVICES)]


def test_wheel_holds_every_package(pyproject: dict[str, Any]) -> None:
    assert pyproject["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"] == packages()


def test_import_linter_reads_every_package(pyproject: dict[str, Any]) -> None:
    linted = pyproject["tool"]["importlinter"]["root_packages"]
    assert sorted(linted) == sorted(path.rpartition("/")[2] for path in packages())


def test_contracts_name_every_service(pyproject: dict[str, Any]) -> None:
    services = sorted(f"pincette_{name}" for name in SERVICES)
    contracts = {item["name"]: item for item in pyproject["tool"]["importlinter"]["contracts"]}
    assert sorted(contracts["Services know nothing of each other"]["modules"]) == services
    assert sorted(contracts["The library knows no service"]["forbidden_modules"]) == services


def test_every_service_has_its_entry_point(pyproject: dict[str, Any]) -> None:
    points = pyproject["project"]["entry-points"]
    inside = [name for name in SERVICES if name not in OUTSIDE_THE_LOOP]
    assert points["pincette.services"] == {name: f"pincette_{name}:SERVICE" for name in inside}
    programs = {name: f"pincette_{name}.program:run" for name in OUTSIDE_THE_LOOP}
    assert programs.items() <= points["pincette.programs"].items()


@pytest.mark.parametrize("name", SERVICES)
def test_service_folders_are_alike(name: str) -> None:
    package = f"pincette_{name}"
    main = "program.py" if name in OUTSIDE_THE_LOOP else "step.py"
    wanted = ["README.md", *(f"{package}/{file}" for file in ("__init__.py", "config.py", main))]
    missing = [file for file in wanted if not (ROOT / "services" / name / file).is_file()]
    assert not missing
