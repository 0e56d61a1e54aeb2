"""What a command prints: words for a person, or JSON for a program."""

import json
import sys
from collections.abc import Sequence
from typing import Any

from pydantic import BaseModel
from rich.console import Console


def screen(*, machine: bool = False) -> Console:
    """Where words go: standard output, or standard error where that belongs to JSON."""
    return Console(highlight=False, stderr=machine)


def emit(value: BaseModel | Sequence[BaseModel] | Any) -> None:
    """Print one JSON document, in one line."""
    sys.stdout.write(json.dumps(tree(value), ensure_ascii=False) + "\n")
    sys.stdout.flush()


def tree(value: Any) -> Any:
    """Models as plain data."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if isinstance(value, list | tuple):
        return [tree(item) for item in value]  # pyright: ignore[reportUnknownVariableType]
    return value
