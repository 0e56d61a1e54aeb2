"""Variants of the demo rig: other ports, the other kind of time, other values."""

import json
import secrets
import socket
from pathlib import Path
from typing import Any, cast
from urllib.parse import urlsplit

from pincette.config import RigFile, parse_rig, read_rig
from pincette.config.reading import laid_over
from pincette.sim.instruments.fitting import resolved

DEMO = Path(__file__).parents[2] / "deploy" / "rigs" / "demo.toml"
KILOHERTZ = DEMO.with_name("kilohertz.toml")
Tree = dict[str, Any]
PORTS = range(16000, 32000)


def free_ports(count: int) -> int:
    """Return the first of ``count`` adjacent ports that are free at the moment.

    They lie below those that systems give to outgoing connections, which could take one between
    this check and the start of the program that is to listen there.
    """
    while True:
        first = PORTS.start + secrets.randbelow(len(PORTS) - count)
        if all(_is_free(first + offset) for offset in range(count)):
            return first


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def demo_rig(changes: Tree | None = None, *, time: str = "real") -> RigFile:
    """Return the demo rig on separate ports, with changes."""
    return at_own_ports(read_rig(DEMO), laid_over({"rig": {"time": time}}, changes or {}))


def paced_rig(changes: Tree | None = None, *, pace: float = 1.0) -> RigFile:
    """Return the same rig in lockstep, at a pace: stalls of the machine cause no trip."""
    return demo_rig(laid_over({"simulation": {"pace": pace}}, changes or {}), time="lockstep")


def output_step_V(rig: RigFile) -> float:
    """Return the step of the simulated output's voltages, in V."""
    assert rig.simulation is not None
    step_V = resolved(rig.simulation, rig.output.driver).output_step_V
    assert step_V is not None
    return step_V


def at_own_ports(rig: RigFile, changes: Tree | None = None) -> RigFile:
    """Return a rig on free ports, with changes."""
    port = free_ports(10)
    own: Tree = {"bus": {"port": port}, "supervisor": {"port": port + 7}}
    tree = rig.model_dump(mode="json", exclude_unset=True)
    for table, offset in (("sensor", 5), ("output", 6)):
        url = urlsplit(cast(str, tree[table]["url"]))
        if url.scheme == "grpc":  # both are channels of one device
            offset = 5
        own[table] = {"url": f"{url.scheme}://127.0.0.1:{port + offset}{url.path}"}
    if rig.second is not None:
        own["second"] = {
            "sensor": {"url": f"socket://127.0.0.1:{port + 8}"},
            "output": {"url": f"socket://127.0.0.1:{port + 9}"},
        }
    return parse_rig(_as_toml_gives(laid_over(laid_over(tree, own), changes or {})))


def _as_toml_gives(tree: Tree) -> Tree:
    """Return tables without absent values, which TOML cannot express."""
    return {
        key: _as_toml_gives(cast(Tree, value)) if isinstance(value, dict) else value
        for key, value in tree.items()
        if value is not None
    }


def rig_toml(rig: RigFile) -> str:
    """Return the text of a rig file."""
    lines: list[str] = []

    def table(name: str, tree: Tree) -> None:
        lines.append(f"[{name}]")
        for key, value in tree.items():
            if not isinstance(value, dict) and value is not None:
                lines.append(f"{key} = {json.dumps(value, ensure_ascii=False)}")
        for key, value in tree.items():
            if isinstance(value, dict):
                table(f"{name}.{key}", cast(Tree, value))

    for name, tree in rig.model_dump(mode="json").items():
        if tree is not None:
            table(name, tree)
    return "\n".join(lines) + "\n"
