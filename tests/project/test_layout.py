"""The list of packages, the entry points and the folders agree."""

import ast
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
SERVICES = sorted(path.name for path in (ROOT / "services").iterdir() if path.is_dir())
OUTSIDE_THE_LOOP = ("recorder", "rig", "supervisor")
SHARED = ("pincette",)
CONTRIB = sorted((ROOT / "contrib").glob("*/pyproject.toml"))
BUILT_ON_THE_LIBRARY = [
    *(f"pincette_{name}" for name in SERVICES),
    *(name for name in SHARED if name != "pincette"),
]


def packages() -> list[str]:
    services = [f"services/{name}/pincette_{name}" for name in SERVICES]
    return [*(f"shared/{name}" for name in SHARED), *services]


def test_wheel_holds_every_package(pyproject: dict[str, Any]) -> None:
    assert pyproject["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"] == packages()


def test_each_file_is_in_exactly_one_wheel(pyproject: dict[str, Any]) -> None:
    client = tomllib.loads((ROOT / "shared/pyproject.toml").read_text(encoding="utf-8"))
    kept = client["tool"]["hatch"]["build"]["only-include"]
    left_out = pyproject["tool"]["hatch"]["build"]["targets"]["wheel"]["exclude"]
    assert left_out == [f"/shared/{name}" for name in kept]
    contracts = {item["name"]: item for item in pyproject["tool"]["importlinter"]["contracts"]}
    bare = contracts["What pincette-client has needs nothing else of pincette"]
    names = {name.removesuffix(".py").replace("/", ".") for name in kept if "__init__" not in name}
    assert set(bare["source_modules"]) == names


def imported_names(source: Path) -> set[str]:
    """Names of pincette that a file imports, as ``pincette.core.files.replace_file``."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module is not None and node.level == 0:
            found.update(f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
    return {name for name in found if name.split(".")[0] == "pincette"}


def test_packages_that_need_only_the_client_import_only_modules_of_its_wheel() -> None:
    client = tomllib.loads((ROOT / "shared/pyproject.toml").read_text(encoding="utf-8"))
    kept = client["tool"]["hatch"]["build"]["only-include"]
    folders = [ROOT / "shared" / name for name in kept]
    for project in CONTRIB:
        needed = tomllib.loads(project.read_text(encoding="utf-8"))["project"]["dependencies"]
        if not any(one.startswith("pincette==") for one in needed):
            folders.append(project.parent / f"pincette_{project.parent.name}")
    assert len(folders) > len(kept)
    modules = [name.removesuffix(".py").replace("/", ".") for name in kept]
    # An __init__.py imports the names it defines, and no other file of its folder.
    bare = {name.removesuffix(".__init__") for name in modules if name.endswith(".__init__")}
    missing = {
        (str(source.relative_to(ROOT)), name)
        for folder in folders
        for source in ([folder] if folder.is_file() else folder.rglob("*.py"))
        for name in imported_names(source)
        if name.rpartition(".")[0] != "pincette" and name not in bare
        if not any(f"{name}.".startswith(f"{module}.") for module in modules)
    }
    assert missing == set()


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


def test_packages_of_contrib_have_the_version_of_pincette(pyproject: dict[str, Any]) -> None:
    version = pyproject["project"]["version"]
    assert CONTRIB
    for path in CONTRIB:
        project = tomllib.loads(path.read_text(encoding="utf-8"))["project"]
        assert (project["name"], project["version"]) == (f"pincette-{path.parent.name}", version)
        own = [one for one in project["dependencies"] if re.match(r"pincette(-client)?\b", one)]
        assert own in ([f"pincette=={version}"], [f"pincette-client=={version}"])


def test_the_core_imports_no_package_of_contrib(pyproject: dict[str, Any]) -> None:
    contracts = {item["name"]: item for item in pyproject["tool"]["importlinter"]["contracts"]}
    (core,) = (one for name, one in contracts.items() if name.startswith("Nothing of the core"))
    kept_out = {f"pincette_{path.parent.name}" for path in CONTRIB}
    assert kept_out <= set(core["forbidden_modules"])


@pytest.mark.parametrize("path", CONTRIB, ids=lambda path: path.parent.name)
def test_an_extra_installs_the_package_of_contrib(path: Path, pyproject: dict[str, Any]) -> None:
    client = tomllib.loads((ROOT / "shared/pyproject.toml").read_text(encoding="utf-8"))
    project = tomllib.loads(path.read_text(encoding="utf-8"))["project"]
    name, wanted = path.parent.name, [f"{project['name']}=={project['version']}"]
    found = [one["project"]["optional-dependencies"].get(name) for one in (pyproject, client)]
    # An extra of the client is for packages that need nothing else of pincette.
    alone = any(one.startswith("pincette-client") for one in project["dependencies"])
    assert found == [None if name == "madsci" else wanted, wanted if alone else None]
