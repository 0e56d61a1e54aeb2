"""The address of a supervisor, in the forms in which people copy it."""

import pytest

from pincette.core.rest_stop import root_of


@pytest.mark.parametrize(
    ("copied", "root"),
    [
        ("http://127.0.0.1:8000", "http://127.0.0.1:8000"),
        ("http://127.0.0.1:8000/", "http://127.0.0.1:8000"),
        ("127.0.0.1:8000", "http://127.0.0.1:8000"),
        ("localhost:8000/", "http://localhost:8000"),
        ("[::1]:8000", "http://[::1]:8000"),
        (" http://bench:8000\n", "http://bench:8000"),
        ("http://127.0.0.1:8000/api/v1", "http://127.0.0.1:8000"),
        ("http://127.0.0.1:8000/api/v1/", "http://127.0.0.1:8000"),
        ("http://127.0.0.1:8000/api/v1/rigs/demo/estop", "http://127.0.0.1:8000"),
        ("https://bench/gripper/api/v1/jobs?limit=5", "https://bench/gripper"),
        ("https://bench/gripper/?rig=demo#jobs", "https://bench/gripper"),
        ("https://bench/gripper/index.html?rig=demo", "https://bench/gripper"),
        ("https://bench/api/v10", "https://bench/api/v10"),
        ("http://bench.html", "http://bench.html"),
        ("HTTPS://bench:8443", "HTTPS://bench:8443"),
    ],
)
def test_the_supervisor_is_found_from_every_copied_address(copied: str, root: str) -> None:
    """`up` prints the address of the interface; a browser shows that of the page."""
    assert root_of(copied) == root
