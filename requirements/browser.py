"""Make a browser available to the tests of the page, where this machine lets us.

Run by make before the tests, with any Python from 3.11 on and its standard library alone. Where
there is none and none can be installed, it says so, and those tests are skipped.
"""

import os
import shutil
import subprocess
import sys

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
PACKAGES = ("chromium", "fonts-dejavu-core")
INSTALL_S = 300.0


def found() -> str:
    """Path of a browser; empty where there is none."""
    return next((path for name in BROWSERS if (path := shutil.which(name))), "")


def obstacle() -> str:
    """Why none can be installed here; empty where one can."""
    if shutil.which("apt-get") is None:
        return "this system has no apt-get"
    if os.geteuid() != 0:
        return "only root may install packages"
    return ""


def install() -> str:
    """Install one from the system's own packages; returns why that failed, or nothing."""
    environment = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
    for words in (["update"], ["install", "-y", "--no-install-recommends", *PACKAGES]):
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
    """Never a reason to stop: what needs a browser says itself that it is skipped."""
    if found():
        return 0
    reason = obstacle()
    if not reason:
        print("installing a browser for the tests of the page", flush=True)
        reason = install()
    if reason:
        names = ", ".join(BROWSERS[:3])
        print(f"no browser ({names}), {reason}: the tests of the page are skipped", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
