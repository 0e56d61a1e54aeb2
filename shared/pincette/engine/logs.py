"""Log lines of programs: text for people, or JSON for machines; never written in a tick."""

import json
import logging
import os
import time
from typing import Any, Literal, get_args

from pincette.engine.log_queue import LogQueue

Form = Literal["text", "json"]
FORMS: tuple[Form, ...] = get_args(Form)
VARIABLE = "PINCETTE_LOG_FORMAT"
KNOWN = frozenset(vars(logging.makeLogRecord({}))) | {"message", "asctime", "taskName"}
"""Attributes of every record; all others were passed as ``extra``."""


class JsonLines(logging.Formatter):
    """Formatter of JSON lines: UTC, level, program, rig, logger, message, and ``extra``."""

    def __init__(self, program: str) -> None:
        super().__init__()
        self._program = program
        self.rig = ""
        """Name of the rig, once its file has been read."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line of a record."""
        at = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created))
        line: dict[str, Any] = {
            "time": f"{at}.{int(record.msecs):03d}Z",
            "level": record.levelname.lower(),
            "program": self._program,
        }
        if self.rig:
            line["rig"] = self.rig
        given = {name: value for name, value in vars(record).items() if name not in KNOWN}
        line |= {name: value for name, value in given.items() if name not in line}
        line |= {"logger": record.name, "message": record.getMessage()}
        if record.exc_info:
            line["error"] = self.formatException(record.exc_info)
        return json.dumps(line, ensure_ascii=False, default=str)


def chosen(given: Form | None) -> Form:
    """Return the form of ``--log-format``, else of the environment, else text.

    Raises ValueError.
    """
    named = given or os.environ.get(VARIABLE) or "text"
    if named not in FORMS:
        raise ValueError(f"{VARIABLE} = {named!r}: expected {' or '.join(FORMS)}")
    return named


def begin(program: str, form: Form) -> JsonLines | None:
    """Send all log lines to standard error in one format; return the formatter if it is JSON, else
    None.

    A thread that logs does not wait until its line has been written; see ``log_queue``.
    """
    if form == "text":
        text = logging.Formatter(f"%(asctime)s {program} %(message)s")
        logging.basicConfig(level=logging.INFO, handlers=[LogQueue(text)])
        return None
    lines = JsonLines(program)
    logging.basicConfig(level=logging.INFO, handlers=[LogQueue(lines)])
    logging.captureWarnings(capture=True)
    return lines
