"""The list of packages, the entry points and the folders say the same; a folder is no crowd."""

import ast
import tomllib
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
SERVICES = sorted(path.name for path in (ROOT / "services").iterdir() if path.is_dir())
OUTSIDE_THE_LOOP = ("foxglove", "recorder", "rig", "sila", "supervisor")
SHARED = ("pincette", "pincette_batch", "pincette_nidaqmx", "pincette_study")
BUILT_ON_THE_LIBRARY = [
    *(f"pincette_{name}" for name in SERVICES),
    *(name for name in SHARED if name != "pincette"),
]
MOST_FILES = 25
FEW_LINES = 40

SMALL_FOR_A_REASON = {
    "pincette.control.safety.watchdog_feed": "part of the safety module, with mutants of its own",
    "pincette_supervisor.rest.routes_catalog": "a router a module",
    "pincette_batch.kernel.estimator": "compiled by itself, beside the scalar code it follows",
    "pincette_sensor.config": "every service has a config.py",
}
"""Modules of fewer than ``FEW_LINES`` lines with one importer, and why they stand alone."""


def packages() -> list[str]:
    services = [f"services/{name}/pincette_{name}" for name in SERVICES]
    return [*(f"shared/{name}" for name in SHARED), *services]


def modules() -> dict[str, Path]:
    """Every module of the product, by its dotted name; packages by their ``__init__``."""
    found: dict[str, Path] = {}
    for package in packages():
        base = (ROOT / package).parent
        for path in sorted((ROOT / package).rglob("*.py")):
            name = ".".join(path.relative_to(base).with_suffix("").parts)
            found[name.removesuffix(".__init__")] = path
    return found


def importers(found: dict[str, Path]) -> dict[str, set[str]]:
    """Which modules import each module."""
    by: defaultdict[str, set[str]] = defaultdict(set)
    for name, path in found.items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                for alias in node.names:
                    by[alias.name].add(name)
            elif isinstance(node, ast.ImportFrom) and node.module:
                for alias in node.names:
                    full = f"{node.module}.{alias.name}"
                    by[full if full in found else node.module].add(name)
    return by


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


def test_no_folder_of_the_product_is_a_crowd(files: list[Path], root: Path) -> None:
    product = [path.relative_to(root) for path in files]
    counts = Counter(path.parent for path in product if path.parts[0] in ("shared", "services"))
    assert {str(folder): n for folder, n in counts.items() if n > MOST_FILES} == {}


def test_small_modules_with_one_importer_have_a_reason(pyproject: dict[str, Any]) -> None:
    found = modules()
    by = importers(found)
    groups: dict[str, dict[str, str]] = pyproject["project"]["entry-points"]
    loaded = {value.partition(":")[0] for group in groups.values() for value in group.values()}
    small = {
        name
        for name, path in found.items()
        if path.stem != "__init__"
        and name not in loaded
        and len(by[name] - {name}) == 1
        and len(path.read_text(encoding="utf-8").splitlines()) < FEW_LINES
    }
    assert small - SMALL_FOR_A_REASON.keys() == set(), "join them to their importer"
    assert SMALL_FOR_A_REASON.keys() - small == set(), "no reason is needed any more"
