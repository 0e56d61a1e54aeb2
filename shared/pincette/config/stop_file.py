"""The values of a rig file that an emergency stop needs to reach actuator and supervisor.

Each value is read separately, so that the rest of the file may be invalid or of a later version.
This module imports no validation library, so that a stop does not wait for the import.
"""

from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, cast

from msgspec import Meta, Struct, ValidationError, convert
from msgspec.structs import fields, replace

from pincette.config.addresses import BusAddresses, supervisor_url
from pincette.config.toml_file import (
    BASE,
    ConfigError,
    Tree,
    laid_over,
    path_beside,
    read_tables,
)
from pincette.core.service import member_services
from pincette.core.topics import RIG_NAME

Port = Annotated[int, Meta(ge=1, le=65535)]
Place = Annotated[str, Meta(pattern=r"^.+:[0-9]{1,5}$")]
T = TypeVar("T", bound=Struct)


class StopRig(Struct, frozen=True):
    """Name of a rig, and its programs that run several services of the loop."""

    name: Annotated[str, Meta(pattern=f"^{RIG_NAME}$")]
    composed: tuple[str, ...] = ()


class StopBus(BusAddresses, Struct, frozen=True):
    """Addresses and certificates of a rig's programs."""

    host: str = "127.0.0.1"
    port: Port = 7447
    router: Place | None = None
    upstream: Place | None = None
    served_at: Literal["upstream", "rig"] = "upstream"
    pki: str | None = None
    identity: str = "operator"


class StopSupervisor(Struct, frozen=True):
    """Address of the supervisor."""

    host: str = "127.0.0.1"
    port: Port = 8000
    tls: bool = False

    @property
    def url(self) -> str:
        """Address of REST and the page."""
        return supervisor_url(self.host, self.port, tls=self.tls)


class StopFile(Struct, frozen=True):
    """Values of a rig file that an emergency stop needs."""

    rig: StopRig
    bus: StopBus = StopBus()
    supervisor: StopSupervisor = StopSupervisor()
    notes: tuple[str, ...] = ()
    """Values that cannot be used, each with its key. Defaults replace them."""

    def program_of(self, service: str) -> str:
        """Return the program that runs a service of the loop."""
        composed = self.rig.composed
        return next((name for name in composed if service in member_services(name)), service)

    def secured(self, pki: Path) -> "StopFile":
        """Return the same rig with a folder of certificates."""
        return replace(self, bus=replace(self.bus, pki=str(pki)))


def read_for_stop(path: Path) -> StopFile:
    """Return the addresses of a rig's actuator and supervisor.

    Raises
    ------
    ConfigError
        Even the name of the rig cannot be read.
    """
    tables, notes = read_tables(path), list[str]()
    base = tables.pop(BASE, None)
    if isinstance(base, str):
        try:
            tables = laid_over(read_tables(path_beside(path, base)), tables)
        except (ConfigError, RecursionError) as error:
            notes.append(f"rig file {path}: its base cannot be used: {error}")
    rig = _usable(StopRig, tables, "rig", path, notes)
    if rig is None:
        raise ConfigError("; ".join([*notes, f"rig file {path}: [rig] name cannot be read"]))
    bus = _usable(StopBus, tables, "bus", path, notes) or StopBus()
    supervisor = _usable(StopSupervisor, tables, "supervisor", path, notes) or StopSupervisor()
    found = StopFile(rig, bus, supervisor, tuple(notes))
    return found if bus.pki is None else found.secured(path_beside(path, bus.pki))


def _usable(kind: type[T], tables: Tree, name: str, path: Path, notes: list[str]) -> T | None:
    """Return the usable values of a table, or None if a required value cannot be used."""
    given: Any = tables.get(name)
    table = cast(Tree, given) if isinstance(given, dict) else {}
    values: Tree = {}
    for field in fields(kind):
        if field.name not in table:
            continue
        try:
            values[field.name] = convert(table[field.name], field.type)
        except ValidationError as error:
            value = repr(table[field.name])[:100]
            notes.append(f"rig file {path}: [{name}] {field.name} = {value}: {error}")
    try:
        return kind(**values)
    except TypeError:
        return None
