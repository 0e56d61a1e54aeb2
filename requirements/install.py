"""Fill .venv with the packages of a step, and install the projects of this tree into it.

Steps: ``run``, what pincette needs to run; ``dev``, what its tests need, too; ``contrib``, what the
packages of contrib and their tests need, too.

Run by make, with any Python from 3.11 on and its standard library alone. A stamp for each step says
for which requirements and which place .venv was filled, so that a moved checkout, another Python or
a changed requirement fills it again and nothing else does. The environment variable VENV names
another folder than .venv.
"""

import ast
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
STEPS = ("run", "dev", "contrib")
"""Steps; each has its pins, requirements/NAME.txt, and contains the steps before it."""
TOOLS = Path("requirements/tools.txt")
"""Pins of the tool that fills .venv; pip installs it before everything else."""
PROJECTS = (Path(), Path("shared"), Path("contrib/nidaqmx"))
"""Folders that each step installs: pincette, its client, and the driver of NI without its packages,
since the rig files for 1 kHz name its simulated instrument."""
APART = ("madsci",)
"""Packages of contrib whose requirements conflict with those of pincette."""
EVERY_S = 10.0
"""Longest time without a line of output if the output is not a terminal, in s."""
PIP = {"PIP_DISABLE_PIP_VERSION_CHECK": "1", "PIP_NO_INPUT": "1", "PIP_USER": "0"}
OF_PIP = {
    "index-url": "UV_DEFAULT_INDEX",
    "extra-index-url": "UV_INDEX",
    "find-links": "UV_FIND_LINKS",
    "no-index": "UV_NO_INDEX",
    "trusted-host": "UV_INSECURE_HOST",
    "cert": "SSL_CERT_FILE",
    "proxy": "ALL_PROXY",
}
"""Settings of pip, and the variables by which uv takes them."""


class InstallError(Exception):
    """A step failed; the text contains the end of the output and the path of the complete log."""


def projects(root: Path, step: str) -> list[Path]:
    """List the folders of the projects that a step installs from this tree."""
    found = sorted(root.glob("contrib/*/pyproject.toml")) if step == "contrib" else []
    folders = [path.parent.relative_to(root) for path in found if path.parent.name not in APART]
    return list(dict.fromkeys([*PROJECTS, *folders]))


def wanted_stamp(root: Path, step: str) -> str:
    """Identification of everything for which .venv must have been filled."""
    digest = hashlib.sha256()
    described = [path / "pyproject.toml" for path in projects(root, step)]
    for source in (Path(f"requirements/{step}.txt"), TOOLS, *described):
        digest.update((root / source).read_bytes())
    return f"{digest.hexdigest()} {root}\n"


def is_usable(root: Path, *, this_python: bool) -> bool:
    """Return whether .venv can be filled further: it works, was made here, and has a suitable
    Python."""
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


def run(what: str, command: list[str], settings: dict[str, str]) -> None:
    """Run a command with its output in a log and its progress on the screen; raises
    InstallError."""
    log = ROOT / VENV / "install.log"
    begin = shown = time.monotonic()
    terminal = sys.stdout.isatty()
    print(f"  {what}", flush=True)
    with log.open("wb") as sink:
        process = subprocess.Popen(
            command, cwd=ROOT, env=os.environ | settings, stdout=sink, stderr=subprocess.STDOUT
        )
    while process.poll() is None:
        time.sleep(0.05)
        if time.monotonic() - shown < (0.3 if terminal else EVERY_S):
            continue
        shown = time.monotonic()
        line = f"    {shown - begin:3.0f} s{progress(log)}"
        print(f"\r{line:<70}" if terminal else line, end="" if terminal else "\n", flush=True)
    if terminal:
        print(f"\r{'':<70}\r", end="", flush=True)
    if process.returncode:
        end = "\n".join(log.read_text(errors="replace").splitlines()[-15:])
        raise InstallError(f"{what}: exit status {process.returncode}; whole text: {log}\n{end}")


def progress(log: Path) -> str:
    """Return the last line that a command has written."""
    lines = log.read_text(errors="replace").split("\n")
    said = [line.strip() for line in lines if line.strip()]
    return f", {said[-1][:50]}" if said else ""


def uv_settings(listed: str) -> dict[str, str]:
    """Variables by which uv finds packages where pip does, from what ``pip config list`` prints.

    pip's own variables come last in that list and override its files, as they do for pip.
    """
    found: dict[str, str] = {}
    for line in sorted(listed.splitlines(), key=lambda line: line.startswith(":env:")):
        name, _, value = line.partition("=")
        section, _, setting = name.partition(".")
        if section in ("global", "install", ":env:") and setting in OF_PIP and value:
            found[OF_PIP[setting]] = " ".join(str(ast.literal_eval(value)).split())
    # pip takes a version from any of its indexes; what is installed is held by its hash.
    found["UV_INDEX_STRATEGY"] = "unsafe-best-match"
    return {name: value for name, value in found.items() if name not in os.environ}


def fill(root: Path, step: str, *, this_python: bool) -> None:
    """Create .venv if necessary, and install the packages of a step."""
    venv = root / VENV
    python = str(venv / "bin/python")
    pip = [python, "-m", "pip", "install", "--progress-bar", "off"]
    if not is_usable(root, this_python=this_python):
        shutil.rmtree(venv, ignore_errors=True)
        venv.mkdir()
        run("a virtual environment", [sys.executable, "-m", "venv", str(venv)], {})
    tools = ["--no-compile", "--require-hashes", "-r", str(TOOLS)]
    run("what installs the others", [*pip, *tools], PIP)
    config = [python, "-m", "pip", "config", "list"]
    settings = uv_settings(subprocess.run(config, capture_output=True, text=True).stdout)
    pins = f"requirements/{step}.txt"
    editable = [word for path in projects(root, step) for word in ("-e", f"./{path}")]
    for what, wanted in (
        (f"the packages of {pins}", ["--require-hashes", "-r", pins]),
        ("pincette itself", ["--no-deps", "--no-build-isolation", *editable]),
    ):
        uv = [str(venv / "bin/uv"), "pip", "install", "--python", python]
        try:
            run(what, [*uv, *wanted], settings)
        except InstallError as error:
            # uv knows fewer ways to a package than pip, such as a certificate of the client.
            print(f"{error}\n  once more by pip", flush=True)
            run(what, [*pip, *wanted], PIP)


def main(step: str, *, this_python: bool) -> int:
    """Fill .venv unless its stamp says that it is filled; one make at a time."""
    wanted = {name: wanted_stamp(ROOT, name) for name in STEPS[STEPS.index(step) :]}
    stamps = {name: ROOT / VENV / f"stamp-{name}" for name in STEPS}

    def is_filled() -> bool:
        if not (ROOT / VENV / "bin/python").exists():
            return False
        if this_python and not is_usable(ROOT, this_python=True):
            return False
        return any(
            stamps[name].exists() and stamps[name].read_text(encoding="utf-8") == text
            for name, text in wanted.items()
        )

    if is_filled():
        return 0
    with (ROOT / TOOLS).open("rb") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            print(f"another make fills {VENV}: waiting", flush=True)
            fcntl.flock(lock, fcntl.LOCK_EX)
        if is_filled():
            return 0
        begin = time.monotonic()
        print(f"filling {VENV} with Python {platform.python_version()}", flush=True)
        for stamp in stamps.values():
            stamp.unlink(missing_ok=True)
        fill(ROOT, step, this_python=this_python)
        stamps[step].write_text(wanted[step], encoding="utf-8")
        print(f"{VENV} is ready after {time.monotonic() - begin:.0f} s", flush=True)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1], this_python="--this-python" in sys.argv))
    except InstallError as error:
        sys.exit(str(error))
    except KeyboardInterrupt:
        sys.exit(130)
