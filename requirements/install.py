"""Make .venv hold what requirements/dev.txt pins, and this checkout, editable.

Run by make, with any Python from 3.11 on and its standard library alone. A stamp in .venv says
for which requirements and which place it was filled, so that a moved checkout, another Python or
a changed requirement fills it again and nothing else does. The environment variable VENV names
another folder than .venv.
"""

import fcntl
import hashlib
import os
import platform
import shutil
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
VENV = os.environ.get("VENV", ".venv")
PINS = Path("requirements/dev.txt")
SOURCES = (PINS, Path("pyproject.toml"))
EVERY_S = 10.0
"""Where the output is no terminal, a line at least this often."""


class InstallError(Exception):
    """A step failed; the text has the end of its output and says where all of it is."""


def wanted_stamp(root: Path) -> str:
    """What .venv must have been filled for."""
    digest = hashlib.sha256()
    for source in SOURCES:
        digest.update((root / source).read_bytes())
    return f"{digest.hexdigest()} {root}\n"


def is_usable(root: Path, *, this_python: bool) -> bool:
    """Whether .venv can be filled further: it runs, was made here, and with a wanted Python."""
    venv = root / VENV
    ask = "import sys; print('%d.%d' % sys.version_info[:2])"
    try:
        # A virtual environment does not bear to be moved: its scripts name their interpreter.
        if f"{venv}/bin/" not in (venv / "bin/pip").read_text(encoding="utf-8"):
            return False
        version = subprocess.check_output([venv / "bin/python", "-c", ask], text=True).strip()
    except (OSError, subprocess.CalledProcessError):
        return False
    if this_python:
        return version == "{}.{}".format(*sys.version_info)
    return tuple(map(int, version.split("."))) >= (3, 11)


def run(what: str, command: list[str], total: int = 0) -> None:
    """Run a step, its output into a log, its progress onto the screen."""
    log = ROOT / VENV / "install.log"
    begin = shown = time.monotonic()
    terminal = sys.stdout.isatty()
    print(f"  {what}", flush=True)
    environment = os.environ | {
        "PIP_DISABLE_PIP_VERSION_CHECK": "1",
        "PIP_NO_INPUT": "1",
        "PIP_USER": "0",
    }
    with log.open("wb") as sink:
        process = subprocess.Popen(
            command, cwd=ROOT, env=environment, stdout=sink, stderr=subprocess.STDOUT
        )
    while process.poll() is None:
        time.sleep(0.1)
        if time.monotonic() - shown < (0.3 if terminal else EVERY_S):
            continue
        shown = time.monotonic()
        line = f"    {shown - begin:3.0f} s{progress(log, total)}"
        print(f"\r{line:<70}" if terminal else line, end="" if terminal else "\n", flush=True)
    if terminal:
        print(f"\r{'':<70}\r", end="", flush=True)
    if process.returncode:
        end = "\n".join(log.read_text(errors="replace").splitlines()[-15:])
        raise InstallError(f"{what}: exit status {process.returncode}; whole text: {log}\n{end}")


def progress(log: Path, total: int) -> str:
    """How far pip has come."""
    lines = log.read_text(errors="replace").splitlines()
    found = [line.split()[1] for line in lines if line.startswith("Collecting ")]
    if not total or not found:
        return ""
    if any(line.startswith("Installing collected") for line in lines):
        return f", unpacking {len(found)} packages"
    return f", package {len(found)} of about {total}: {found[-1].split('==')[0]}"


def fill(root: Path, *, this_python: bool) -> None:
    """Make .venv where needed, and install."""
    venv = root / VENV
    if not is_usable(root, this_python=this_python):
        shutil.rmtree(venv, ignore_errors=True)
        venv.mkdir()
        run("a virtual environment", [sys.executable, "-m", "venv", str(venv)])
    pip = [str(venv / "bin/python"), "-m", "pip", "install", "--progress-bar", "off"]
    total = (root / PINS).read_text(encoding="utf-8").count("==")
    run(f"the packages of {PINS}", [*pip, "--require-hashes", "-r", str(PINS)], total)
    run("pincette itself", [*pip, "--no-deps", "--no-build-isolation", "-e", "."])


def main() -> int:
    """Fill .venv unless its stamp says that it is filled; one make at a time."""
    stamp = ROOT / VENV / "stamp"
    wanted = wanted_stamp(ROOT)

    this_python = "--this-python" in sys.argv

    def is_filled() -> bool:
        if not stamp.exists() or not (ROOT / VENV / "bin/python").exists():
            return False
        if this_python and not is_usable(ROOT, this_python=True):
            return False
        return stamp.read_text(encoding="utf-8") == wanted

    if is_filled():
        return 0
    with (ROOT / PINS).open("rb") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            print(f"another make fills {VENV}: waiting", flush=True)
            fcntl.flock(lock, fcntl.LOCK_EX)
        if is_filled():
            return 0
        begin = time.monotonic()
        print(f"filling {VENV} with Python {platform.python_version()}", flush=True)
        stamp.unlink(missing_ok=True)
        fill(ROOT, this_python=this_python)
        stamp.write_text(wanted, encoding="utf-8")
        print(f"{VENV} is ready after {time.monotonic() - begin:.0f} s", flush=True)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InstallError as error:
        sys.exit(str(error))
    except KeyboardInterrupt:
        sys.exit(130)
