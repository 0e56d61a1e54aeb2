"""Compilation by numba, an extra; the only file that imports it.

No fast mathematics: every operation rounds as Python's does, none is fused with another, and
exponentials come from the same library. What has been compiled is kept in the user's cache folder,
by the digest of its code.
"""

import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar, cast

from pincette.core.user_folders import cache_folder
from pincette_batch.compiling.linking import Function, Linker

Kernel = TypeVar("Kernel", bound=Callable[..., Any])


class CompilerMissingError(ImportError):
    """The extra is not installed."""


@cache
def available() -> bool:
    """Whether there is a compiler."""
    return find_spec("numba") is not None


def of_the_library(name: str) -> Any:
    """A function of the C library, from a float to a float, for a kernel to call.

    Raises
    ------
    CompilerMissingError
        Where numba is not installed.
    """
    numba_ = _numba()
    return numba_.types.ExternalFunction(name, numba_.float64(numba_.float64))


def compiled(kernel: Kernel, instead: Mapping[Function, Function] | None = None) -> Kernel:
    """A function of floats, arrays and flat records as machine code; same bits, same arguments.

    The first call with arguments of new types compiles, which takes seconds, unless an earlier
    process has done so. A kernel may take and cut arrays, but not make any.

    Parameters
    ----------
    instead
        See ``Linker``.

    Raises
    ------
    CompilerMissingError
        Where numba is not installed.
    """
    numba_ = _numba()
    linker = Linker(numba_.njit(error_model="numpy"), instead or {})
    inner: Any = linker.link(kernel)
    folder = _cache_folder(f"{linker.digest()}-{numba_.__version__}")
    before = numba_.config.CACHE_DIR
    # Without a place to keep it, each process compiles anew.
    with suppress(OSError, RuntimeError):
        folder.mkdir(parents=True, exist_ok=True)
        numba_.config.CACHE_DIR = str(folder)
        inner.enable_caching()
    numba_.config.CACHE_DIR = before
    return cast(Kernel, inner)


def _numba() -> Any:
    if not available():
        raise CompilerMissingError(
            "compiling needs the package numba: pip install 'pincette[batch]'"
        )
    import numba

    return numba


def _cache_folder(digest: str) -> Path:
    """Raises RuntimeError where there is no home."""
    tag, caches = sys.implementation.cache_tag, cache_folder()
    if caches is None:
        raise RuntimeError("this account has no home, and XDG_CACHE_HOME is not set")
    return caches / "pincette" / "compiled" / f"{digest}-{tag}"
