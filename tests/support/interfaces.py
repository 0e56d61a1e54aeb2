"""What callers rely on, as digests without words: REST, keys and messages, features of SiLA."""

import hashlib
import json
import re
from pathlib import Path
from typing import Any, cast
from xml.etree import ElementTree

from pincette.core.topics import ROOT as WIRE_ROOT
from pincette_supervisor.problems import SERVED

ROOT = Path(__file__).parents[2]
SILA = "services/sila/pincette_sila/features/Microgripper-v1_0.sila.xml"
DOCUMENTS = {
    "REST": "deploy/openapi.json",
    "keys and messages": "deploy/asyncapi.json",
    "SiLA features": SILA,
}
VERSIONS = {
    "REST": SERVED.rpartition("/")[2],
    "keys and messages": WIRE_ROOT.rpartition("/")[2],
    "SiLA features": f"v{ElementTree.parse(ROOT / SILA).getroot().attrib['FeatureVersion'][0]}",
}
WORDS = {"description", "summary", "title", "example", "examples", "info"}
"""Members that say something to people, and change nothing for a program."""
NAMED = {"properties", "patternProperties", "schemas", "messages", "channels", "parameters"}
"""Members whose own members are names, which may be any word."""
ROW = re.compile(r"^\| (?P<name>[\w ]+?) \| (?P<version>v\d+) \| `(?P<digest>[0-9a-f]{16})` \|$")


def bare(node: Any, *, names: bool = False) -> Any:
    """A document without its words."""
    if isinstance(node, list):
        return [bare(item) for item in cast("list[Any]", node)]
    if not isinstance(node, dict):
        return node
    return {
        key: bare(value, names=not names and key in NAMED)
        for key, value in cast("dict[str, Any]", node).items()
        if names or key not in WORDS
    }


def digest(document: Any) -> str:
    """Of what a document says to programs, whatever the order of its members."""
    text = json.dumps(bare(document), sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def digests() -> dict[str, str]:
    """Of each interface as it is."""
    return {name: digest(_document(ROOT / place)) for name, place in DOCUMENTS.items()}


def _document(path: Path) -> Any:
    if path.suffix == ".json":
        return json.loads(path.read_text(encoding="utf-8"))
    files = sorted(path.parent.glob("*.xml"))
    return {one.name: _element(ElementTree.parse(one).getroot()) for one in files}


def _element(node: ElementTree.Element) -> list[Any]:
    tag, text = node.tag.rpartition("}")[2], (node.text or "").strip()
    said = {"DisplayName", "Description"}
    inner = [_element(one) for one in node if one.tag.rpartition("}")[2] not in said]
    return [tag, dict(node.attrib), text, inner]


def stated(changelog: str) -> dict[str, tuple[str, str]]:
    """Version and digest of each interface by the newest part of the changelog."""
    newest = re.split(r"^## ", changelog, flags=re.MULTILINE)[1]
    rows = (ROW.match(line) for line in newest.splitlines())
    return {row["name"]: (row["version"], row["digest"]) for row in rows if row}


def complaint(name: str, said: tuple[str, str] | None, version: str, now: str) -> str:
    """What is to be done where the changelog and an interface differ; empty where they do not."""
    if said == (version, now):
        return ""
    row = f"| {name} | {version} | `{now}` |"
    if said is None or said[1] == now:
        return f"CHANGELOG.md, newest part, Interfaces: write {row}"
    return (
        f"{name} ({DOCUMENTS[name]}) has changed: its digest is {now}. Say what in the newest "
        f"part of CHANGELOG.md, and write {row} there. Where what was right before is refused now, "
        f"or a member has gone or means something else, raise the version {version} first: "
        + {
            "REST": "SERVED in services/supervisor/pincette_supervisor/problems.py",
            "keys and messages": "WIRE in shared/pincette/core/topics.py",
            "SiLA features": "FeatureVersion in it, and the name of its file",
        }[name]
    )
