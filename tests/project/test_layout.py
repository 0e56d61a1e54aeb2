"""The list of packages, the entry points and the folders agree."""

import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
SERVICES = sorted(path.name for path in (ROOT / "services").iterdir() if path.is_dir())
OUTSIDE_THE_LOOP = ("foxglove", "recorder", "rig", "sila", "supervisor")
SHARED = ("pincette", "pincette_nidaqmx", "pincette_study")
BUILT_ON_THE_LIBRARY = [
    *(f"pincette_{name}" for name in SERVICES),
    *(name for name in SHARED if name != "pincette"),
]


def packages() -> list[str]:
    services = [f"services/{name}/pincette_{name}" for name in SERVICES]
    return [*(f"shared/{name}" for name in SHARED), *services]


def test_wheel_holds_every_package(pyproject: dict[str, Any]) -> None:
    assert pyproject["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"] == packages()


def test_a_file_is_in_one_wheel(pyproject: dict[str, Any]) -> None:
    client = tomllib.loads((ROOT / "shared/pyproject.toml").read_text(encoding="utf-8"))
    kept = client["tool"]["hatch"]["build"]["only-include"]
    left_out = pyproject["tool"]["hatch"]["build"]["targets"]["wheel"]["exclude"]
    assert left_out == [f"/shared/{name}" for name in kept]
    contracts = {item["name"]: item for item in pyproject["tool"]["importlinter"]["contracts"]}
    bare = contracts["What pincette-client has needs nothing else of pincette"]
    names = {name.removesuffix(".py").replace("/", ".") for name in kept if "__init__" not in name}
    assert set(bare["source_modules"]) == names


def test_import_linter_reads_every_package(pyproject: dict[str, Any]) -> None:
    linted = pyproject["tool"]["importlinter"]["root_packages"]
    assert sorted(linted) == sorted(path.rpartition("/")[2] for path in packages())


def test_contracts_name_every_package(pyproject: dict[str, Any]) -> None:
    services = sorted(f"pincette_{name}" for name in SERVICES)
    contracts = {item["name"]: item for item in pyproject["tool"]["importlinter"]["contracts"]}
    assert sorted(contracts["Services know nothing of each other"]["modules"]) == services
    library = contracts["The library knows no service, and nothing that is built on it"]
    assert sorted(library["forbidden_modules"]) == sorted(BUILT_ON_THE_LIBRARY)


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
    config = [] if name in OUTSIDE_THE_LOOP else ["config.py"]
    modules = ["__init__.py", *config, main]
    wanted = ["README.md", *(f"{package}/{file}" for file in modules)]
    missing = [file for file in wanted if not (ROOT / "services" / name / file).is_file()]
    assert not missing
