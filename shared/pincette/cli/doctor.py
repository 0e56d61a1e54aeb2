"""`pincette doctor`: what is missing for a rig, and how to get it."""

import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

import httpx
from packaging.requirements import Requirement
from rich.console import Console

from pincette import plugins
from pincette.cli.rest import CliError
from pincette.cli.rig_file import opened
from pincette.config import RigFile
from pincette.instruments.protocols import InstrumentError
from pincette.runtime.devices import open_device
from pincette.runtime.fleet import FleetError, check_ports
from pincette.runtime.process import loop_services
from pincette.service import AnyService

FREE_MIB = 200
ASK_S = 2.0
