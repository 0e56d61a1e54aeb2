"""Contents of an image, as its own Python sees them."""

import json
from dataclasses import dataclass

from tests.support.engine import told

LISTING = """\
import json, os, shutil, sys
from importlib.metadata import distributions
ends = (".whl", ".o", ".tar.gz")
names = ("pip", "setuptools", "wheel", "ensurepip", ".cache", ".git", "__pypackages__")
odd = []
for folder, folders, files in os.walk("/"):
    if folder == "/":
        folders[:] = [one for one in folders if one not in ("proc", "sys", "dev")]
    for one in folders + files:
        if one.endswith(ends) or one in names:
            odd.append(os.path.join(folder, one))
places = ("/", "/etc", "/opt", "/usr/bin", sys.prefix)
print(json.dumps({
    "user": os.getuid(),
    "tools": [one for one in sys.argv[1:] if shutil.which(one)],
    "odd": odd,
    "packages": {one.name: one.version for one in distributions()},
    "writable": [one for one in places if os.access(one, os.W_OK)],
}))
"""
COMPILERS = ("gcc", "cc", "c++", "g++", "clang", "ld", "as", "cargo", "rustc")
TOOLS = (*COMPILERS, "make", "cmake", "pip", "pip3", "git")


@dataclass(frozen=True)
class Contents:
    """Packages and files found in an image."""

    user: int
    tools: list[str]
    odd: list[str]
    """Files that only a build needs or leaves behind."""
    packages: dict[str, str]
    writable: list[str]


def contents(image: str) -> Contents:
    """List the contents of an image."""
    line = ("run", "--rm", "--network", "none", "--entrypoint", "python", image, "-Ic", LISTING)
    return Contents(**json.loads(told(*line, *TOOLS, timeout_s=120.0)))
