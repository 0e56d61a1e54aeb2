"""Install the programs that some tests need and pip cannot install: a browser, proxies.

Run by make before the tests, with any Python from 3.11 on and its standard library alone. A program
that is missing and cannot be installed is reported, and its tests are skipped.
"""

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass

INSTALL_S = 300.0
PATH = os.pathsep.join([os.environ.get("PATH", os.defpath), "/usr/sbin"])


@dataclass(frozen=True)
class Program:
    """A program, the names of its command, and its Debian packages."""

    what: str
    commands: tuple[str, ...]
    packages: tuple[str, ...]
    tests: str

    def found(self) -> bool:
        """Whether one of its commands is installed."""
        return any(shutil.which(name, path=PATH) for name in self.commands)


PROXIES = "of the reverse proxies"
SERVERS = "of device servers"
PROGRAMS = (
    Program(
        "browser",
        ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable"),
        ("chromium", "fonts-dejavu-core"),
        "of the page",
    ),
    Program("Firefox", ("firefox-esr", "firefox"), ("firefox-esr",), "of the page in Firefox"),
    Program("nginx", ("nginx",), ("nginx-light",), PROXIES),
    Program("HAProxy", ("haproxy",), ("haproxy",), PROXIES),
    Program("tinyproxy", ("tinyproxy",), ("tinyproxy-bin",), "of webhooks behind a forward proxy"),
    Program("Caddy", ("caddy",), ("caddy",), PROXIES),
    Program("ser2net", ("ser2net",), ("ser2net",), SERVERS),
    Program("socat", ("socat",), ("socat",), SERVERS),
)


def obstacle() -> str:
    """Return why nothing can be installed here; empty if it can."""
    if shutil.which("apt-get") is None:
        return "this system has no apt-get"
    if os.geteuid() != 0:
        return "only root may install packages"
    return ""


def apt_get(*words: str) -> str:
    """Run apt-get; return why it failed, or nothing."""
    # RUNLEVEL keeps the servers among the packages from being started.
    environment = os.environ | {"DEBIAN_FRONTEND": "noninteractive", "RUNLEVEL": "1"}
    command = ["apt-get", "-qq", *words]
    try:
        subprocess.run(
            command,
            env=environment,
            timeout=INSTALL_S,
            check=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
    except subprocess.CalledProcessError as error:
        lines = str(error.stdout).strip().splitlines()
        return f"{' '.join(command)}: {lines[-1] if lines else f'exit {error.returncode}'}"
    except subprocess.TimeoutExpired:
        return f"{' '.join(command)}: took longer than {INSTALL_S:g} s"
    return ""


def main() -> int:
    """Install what is missing; a failure is no reason to stop, because the tests report it."""
    missing = [program for program in PROGRAMS if not program.found()]
    if not missing:
        return 0
    reason = obstacle()
    if not reason:
        names = ", ".join(program.what for program in missing)
        print(f"installing programs for the tests: {names}", flush=True)
        reason = apt_get("update")
    for program in missing:
        why = reason or apt_get("install", "-y", "--no-install-recommends", *program.packages)
        if why:
            print(f"no {program.what}, {why}: the tests {program.tests} are skipped", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
