"""Mutation testing of the safety module: every small change to it must be noticed by a unit test.

    python -m tests.mutants.run [PATTERN …]

mutmut works on a copy, so the checkout stays as it is. A surviving mutant is printed with its
change. The run fails if ``survivors.toml`` has no reason for a survivor, or a reason for a mutant
that no longer survives. Patterns select mutants by name.
"""

import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[2]
REGISTER = Path(__file__).parent / "survivors.toml"
PACKAGES = ("shared/pincette", "services/actuator/pincette_actuator")
MUTATED = ("src/pincette/control/safety/*", "src/pincette_actuator/*")
TESTS = ("tests/unit/control/safety", "tests/unit/actuator")
SEARCHES = ("test_two_controllers.py", "test_exploration.py")
"""Long random tests; cases that they find should become tests of their own."""
CONFIG = """
[tool.pytest.ini_options]
pythonpath = ["."]
addopts = "--import-mode=importlib -p no:cacheprovider -p no:xdist --hypothesis-profile=ci"
markers = ["slow: not here"]
[tool.mutmut]
source_paths = ["src"]
only_mutate = {mutated}
also_copy = ["deploy"]
pytest_add_cli_args_test_selection = {tests}
"""
KILLED = ("killed", "timeout", "caught by type check")


def laid_out(place: Path) -> None:
    """Copy the mutated code, its dependencies and its tests."""
    skip = shutil.ignore_patterns("__pycache__", *SEARCHES)
    for source in PACKAGES:
        target = place / "src" / Path(source).name
        shutil.copytree(ROOT / source, target, ignore=skip)
    for tests in TESTS:
        shutil.copytree(ROOT / tests, place / tests, ignore=skip)
    shutil.copytree(ROOT / "tests" / "support", place / "tests" / "support", ignore=skip)
    shutil.copytree(ROOT / "deploy" / "rigs", place / "deploy" / "rigs")
    lists = {"mutated": list(MUTATED), "tests": list(TESTS)}
    text = CONFIG.format(**{key: str(value).replace("'", '"') for key, value in lists.items()})
    (place / "pyproject.toml").write_text(text, encoding="utf-8")


def mutmut(place: Path, *words: str) -> str:
    """Run a command of mutmut; returns its output."""
    command = (sys.executable, "-m", "mutmut", *words)
    done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.stderr.write(done.stdout[-4000:] + done.stderr[-4000:])
        raise SystemExit(f"mutmut {' '.join(words)} ended with {done.returncode}")
    return done.stdout


def outcomes(place: Path) -> dict[str, str]:
    """Return the outcome of each mutant, by name."""
    lines = mutmut(place, "results", "--all", "true").splitlines()
    pairs = [line.strip().rsplit(": ", 1) for line in lines if ": " in line]
    return {pair[0]: pair[1] for pair in pairs}


def judged(place: Path, patterns: Sequence[str]) -> int:
    """Print the survivors and compare them with the register; returns the exit status."""
    found = {name: end for name, end in outcomes(place).items() if end != "not checked"}
    survivors = sorted(name for name, end in found.items() if end not in KILLED)
    reasons: dict[str, str] = tomllib.loads(REGISTER.read_text(encoding="utf-8"))
    for name in survivors:
        print(f"== {found[name]}: {name}")
        print(f"   {reasons[name]}" if name in reasons else mutmut(place, "show", name))
    unknown = [name for name in survivors if name not in reasons]
    stale = [] if patterns else sorted(reasons.keys() - set(survivors))
    print(f"{len(found)} mutants, {len(survivors)} survive, {len(unknown)} without a reason")
    for name in stale:
        print(f"{REGISTER.name}: {name} does not survive: remove it from the list")
    return 1 if unknown or stale or not found else 0


def main(patterns: Sequence[str]) -> int:
    """Copy, mutate and compare."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        laid_out(place)
        mutmut(place, "run", *patterns)
        return judged(place, patterns)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
