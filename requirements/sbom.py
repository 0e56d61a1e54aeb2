"""Write the Python packages of each image as CycloneDX: ``make sbom``.

It reads the pins with which the images are filled, for their version of Python, and the licences
from the metadata of the same packages in .venv. The packages of the base image are not included.
"""

import json
import re
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path
from typing import Any

from cyclonedx.contrib.license.factories import LicenseFactory
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.output import make_outputter
from cyclonedx.schema import OutputFormat, SchemaVersion
from packageurl import PackageURL
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
IMAGES = {
    "pincette-loop": "loop",
    "pincette": "run",
    "pincette-adapters": "adapters",
    "pincette-madsci": "madsci",
}
"""Images, and the pins that each is filled from."""
MakeBom: Any = Bom
MakeComponent: Any = Component
"""Decorators of the library hide the types of these two functions."""
CLASSIFIED = "License :: OSI Approved :: "


def environment(dockerfile: str) -> dict[str, str]:
    """Return the environment of an image for markers, by the Python version in its Dockerfile."""
    found = re.search(r"^ARG PYTHON=python:(\d+\.\d+)-slim$", dockerfile, re.MULTILINE)
    if found is None:
        sys.exit("deploy/Dockerfile: no line ARG PYTHON=python:X.Y-slim")
    return {
        "python_version": found[1],
        "python_full_version": f"{found[1]}.0",
        "implementation_name": "cpython",
        "platform_python_implementation": "CPython",
        "sys_platform": "linux",
        "platform_system": "Linux",
    }


def pins(text: str, where: dict[str, str]) -> Iterator[tuple[str, str]]:
    """Return name and version of each pin that applies in an environment."""
    for line in text.splitlines():
        if "==" not in line:
            continue
        pin = Requirement(line.rstrip(" \\"))
        if pin.marker is None or pin.marker.evaluate(where):
            (version,) = [one.version for one in pin.specifier]
            yield pin.name, version


def licence(name: str) -> str:
    """Return the licence that a package states; empty if it states none or is not installed
    here."""
    try:
        told = metadata(name)
    except PackageNotFoundError:
        return ""

    def said(field: str) -> list[str]:
        return [str(line) for line in told.get_all(field) or []]

    classified = [one for one in said("Classifier") if one.startswith(CLASSIFIED)]
    words = [one.removeprefix(CLASSIFIED) for one in classified]
    words = words or [one.splitlines()[0] for one in said("License") if one]
    return " AND ".join(said("License-Expression") or words)


def component(name: str, version: str) -> Component:
    """Return one package as a component."""
    said = licence(name)
    # What is no expression of SPDX is kept as the words that it is.
    found = LicenseFactory().make_from_string(said) if said else None
    return MakeComponent(
        name=name,
        version=version,
        type=ComponentType.LIBRARY,
        bom_ref=f"{name}=={version}",
        purl=PackageURL("pypi", name=name, version=version),
        licenses=None if found is None else [found],
    )


def bill(image: str, version: str, packages: Iterator[tuple[str, str]]) -> str:
    """Return the whole document of an image, as JSON."""
    own: Any = MakeComponent(
        name=image,
        version=version,
        type=ComponentType.CONTAINER,
        bom_ref=image,
        licenses=[LicenseFactory().make_from_string("Apache-2.0")],
    )
    document: Any = MakeBom(components=[component(*one) for one in packages])
    document.metadata.component = own
    document.register_dependency(own, document.components)
    made = make_outputter(document, OutputFormat.JSON, SchemaVersion.V1_6)
    return made.output_as_string(indent=2)


def main(folder: Path) -> None:
    """Write a document for each image."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    where = environment((ROOT / "deploy/Dockerfile").read_text(encoding="utf-8"))
    folder.mkdir(parents=True, exist_ok=True)
    for image, name in IMAGES.items():
        text = (ROOT / f"requirements/{name}.txt").read_text(encoding="utf-8")
        made = bill(image, project["version"], pins(text, where))
        place = folder / f"{image}.cdx.json"
        place.write_text(f"{made}\n", encoding="utf-8")
        print(f"{place}: {len(json.loads(made)['components'])} packages")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
