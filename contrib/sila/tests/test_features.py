"""The feature definitions of the SiLA server are valid, described completely, and implemented."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from sila2.framework import Feature

import pincette_sila.features
from pincette.client.errors import RAISED
from pincette_sila.errors import NAMES, CommandError, command_error
from pincette_sila.features import MICROGRIPPER, feature
from pincette_sila.gripper import FOLLOWERS, MOVING, Gripper
from pincette_sila.motion import Sample
from tests.support.checkout import ROOT

FILES = sorted(Path(pincette_sila.features.__file__).parent.glob("*.sila.xml"))
SPACE = "{http://www.sila-standard.org}"
WORDS_MIN = 6
DETAIL = "7 mN, limit 5 mN"
"""The text is shown unchanged to the user of a SiLA client."""


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_definition_is_valid_and_named_by_its_version(path: Path) -> None:
    found = Feature(str(path))  # checks the schema of the standard
    root = ElementTree.parse(path).getroot()
    name, version = path.name.removesuffix(".sila.xml").split("-v")
    assert root.findtext(f"{SPACE}Identifier") == name
    assert root.attrib["FeatureVersion"] == version.replace("_", ".")
    assert found.fully_qualified_identifier.split("/")[2] == name


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_feature_is_described(path: Path) -> None:
    def short(node: ElementTree.Element) -> Iterator[str]:
        for one in node.iter():
            name, text = one.findtext(f"{SPACE}Identifier"), one.findtext(f"{SPACE}Description")
            if name is not None and text is not None and len(text) < WORDS_MIN:
                yield name

    assert list(short(ElementTree.parse(path).getroot())) == []


def test_invalid_features_are_found(tmp_path: Path) -> None:
    text = FILES[-1].read_text(encoding="utf-8")
    for odd in (
        text.replace("<Observable>No</Observable>", "", 1),
        text.replace("<Basic>Boolean</Basic>", "<Basic>Truth</Basic>", 1),
    ):
        assert odd != text
        path = tmp_path / "odd.sila.xml"
        path.write_text(odd, encoding="utf-8")
        with pytest.raises((ValueError, KeyError, SyntaxError)):
            Feature(str(path))


def test_every_command_and_property_is_implemented() -> None:
    root: Any = ElementTree.parse(Path(FILES[0].parent / f"{MICROGRIPPER}.sila.xml")).getroot()
    for command in root.findall(f"{SPACE}Command"):
        name = command.findtext(f"{SPACE}Identifier")
        assert callable(getattr(Gripper, name))
        moves = command.findtext(f"{SPACE}Observable") == "Yes"
        assert moves == (name in MOVING) == (name in (*FOLLOWERS, "GripSeries"))
    for one in root.findall(f"{SPACE}Property"):
        name = one.findtext(f"{SPACE}Identifier")
        observable = one.findtext(f"{SPACE}Observable") == "Yes"
        assert callable(
            getattr(Gripper, f"{name}_on_subscription" if observable else f"get_{name}")
        )


def test_a_sample_has_the_members_of_its_definition() -> None:
    sent = Sample("hold", 31.5, 14.9, -1.0, 2.4, True)
    node: Any = feature(MICROGRIPPER)
    message = node["Grip"].intermediate_responses.to_message(sent)
    assert node["Grip"].intermediate_responses.to_native_type(message).Sample == tuple(sent)


def test_every_refusal_that_the_client_can_raise_has_an_error_defined_in_the_feature() -> None:
    there = feature(MICROGRIPPER).defined_execution_errors
    assert set(NAMES.values()) <= there.keys()
    for code, raised in RAISED.items():
        problem = {"type": f"urn:pincette:problem:{code}", "title": "Title", "detail": DETAIL}
        error = command_error(raised(409, problem))
        assert isinstance(error, CommandError)
        assert error.identifier == NAMES[raised]
        assert DETAIL in str(error)


def test_the_changelog_states_the_version_of_the_sila_features() -> None:
    (feature,) = (path for path in FILES if path.name.startswith("Microgripper-"))
    version = ElementTree.parse(feature).getroot().attrib["FeatureVersion"].partition(".")[0]
    newest = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").split("\n## ")[1]
    assert f"| SiLA features | v{version} |" in newest
