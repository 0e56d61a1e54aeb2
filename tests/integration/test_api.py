"""The supervisor replies to every request as its OpenAPI document states, and never fails."""

# The package leaves the types of its generic classes open.
# pyright: reportUnknownVariableType=false

from collections.abc import Generator
from contextlib import closing
from typing import Any, cast

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from hypothesis.errors import Unsatisfiable
from schemathesis import GenerationMode
from schemathesis.specs.openapi.checks import (
    ignored_auth,
    negative_data_rejection,
    positive_data_acceptance,
)

from pincette_supervisor.access.access import Access, KeySync
from tests.support.api_document import openapi
from tests.support.apps import create_app
from tests.support.keys import ScopeKeys, key_of_each_scope
from tests.support.rigs import demo_rig
from tests.unit.supervisor.harness import Harness

SEED = 20131
EXAMPLES, MORE, MANY = 2, 8, 40
"""Number of requests per operation and mode: in `make test`, in `make test-full`, and in `make
soak`."""
WITH_KEYS = 5
"""Clients with one key of each kind."""
NAMES = frozenset({"testserver"})
"""Names that schemathesis uses."""
PATIENCE_S = 0.05
"""Longest time that a request may wait for a job without progress, in s."""
ANSWER_S = 120.0
"""Longest time of a reply on a busy machine, in s: only a hanging request takes longer."""
LONGEST_S, ALLOWED_S = 20.0, 3600.0
"""Durations are kept short: planning an hour takes seconds and tests nothing more."""
JUDGED = frozenset(
    {"jobs", "actions", "commands", "calibrations", "trajectories", "plot", "recipes", "series"}
)
"""Ends of paths whose requests are also validated beyond the schema: whether members are
compatible, and whether rig and model allow the values."""
ENDLESS = ("/live", "/events")
"""Ends of the paths of streams; ``test_live`` and ``test_event_routes`` read them."""
OPERATIONS = [
    (method, path)
    for path, methods in openapi()["paths"].items()
    for method in methods
    if not path.endswith(ENDLESS)
]
Known = dict[str, list[str]]


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Generator[Harness]:
    desk = Harness(demo_rig(time="lockstep"), tmp_path_factory.mktemp("desk"))
    desk.app = create_app(desk.rigs, Access(names=NAMES))
    yield desk
    desk.close()


@pytest.fixture(scope="module")
def described(desk: Harness) -> Any:
    return schemathesis.openapi.from_asgi("/openapi.json", desk.app)


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Generator[tuple[Any, ScopeKeys]]:
    """Return the OpenAPI document of a supervisor that requires keys, and its keys."""
    desk = Harness(demo_rig(time="lockstep"), tmp_path_factory.mktemp("guarded"))
    access = Access(names=NAMES)
    desk.app = create_app(desk.rigs, access)
    ring = key_of_each_scope(desk.store, access.authenticator)
    # A key table that was not read for 15 s is no longer valid.
    with closing(desk), closing(KeySync(desk.store, access)):
        yield schemathesis.openapi.from_asgi("/openapi.json", desk.app), ring


@pytest.fixture(scope="module")
def known(desk: Harness) -> Known:
    """Return the names that exist: a random guess would never find one."""
    grip = desk.grip()["id"]
    desk.ended(grip)
    calibration = desk.calibrated()["id"]
    series = desk.post("/series", {"job": {"kind": "grip"}}).json()["id"]
    desk.get(f"/series/{series}", wait="over", timeout_s=30)
    return {
        "job": [grip, calibration],
        "calibration": [calibration],
        "rig": [desk.get("/rigs")["rigs"][0]["name"]],
        "series": [series],
        "name": ["samples.parquet", "manifest.json", "grip.png"],
    }


TOO_LARGE = 413


def excluded(method: str, path: str, *, keys: bool) -> list[Any]:
    """Checks of the library that cannot pass here; every other one must."""
    # Without keys, any key opens everything.
    without: list[Any] = [] if keys else [ignored_auth]
    if method == "post" and path.rpartition("/")[2] in JUDGED:
        without.append(positive_data_acceptance)
    return without


def aim(case: Any, data: st.DataObject, known: Known) -> None:
    """Use existing names in most requests, and limit waiting times."""
    for name in cast("dict[str, Any]", case.path_parameters or {}):
        if name in known and data.draw(st.integers(0, 3), label="known"):
            case.path_parameters[name] = data.draw(st.sampled_from(known[name]), label=name)
    query = cast("dict[str, Any]", case.query or {})
    if isinstance(query.get("timeout_s"), int | float):
        query["timeout_s"] = min(query["timeout_s"], PATIENCE_S)
    elif "wait" in query and "timeout_s" not in query:
        query["timeout_s"] = PATIENCE_S
    case.query = query
    if isinstance(case.body, dict):
        body = cast("dict[str, Any]", case.body)
        for name, value in body.items():
            if name.endswith("_s") and isinstance(value, float) and LONGEST_S < value <= ALLOWED_S:
                body[name] = LONGEST_S


def sent(
    described: Any, known: Known, method: str, path: str, mode: GenerationMode, examples: int
) -> None:
    """Send generated requests of one operation, and check each reply against the document."""
    cases = described[path][method].as_strategy(generation_mode=mode)

    @seed(SEED)
    @settings(
        max_examples=examples,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
    )
    @given(case=cases, data=st.data())
    def answers(case: Any, data: st.DataObject) -> None:
        aim(case, data, known)
        response = case.call(timeout=ANSWER_S)
        without = excluded(method, path, keys=False)
        if response.status_code == TOO_LARGE:  # refused before it was validated
            without.append(negative_data_rejection)
        case.validate_response(response, excluded_checks=without)

    try:
        answers()
    except Unsatisfiable:
        assert mode is GenerationMode.NEGATIVE, "nothing can be asked"
        pytest.skip("this request has no field that could be invalid")


@pytest.mark.parametrize(("method", "path"), OPERATIONS)
def test_every_refusal_is_documented(described: Any, known: Known, method: str, path: str) -> None:
    """Replies to valid requests are checked below, where keys are required."""
    sent(described, known, method, path, GenerationMode.NEGATIVE, EXAMPLES)


@pytest.mark.parametrize("mode", GenerationMode, ids=lambda mode: mode.value)
@pytest.mark.parametrize(("method", "path"), OPERATIONS)
def test_responses_to_less_common_requests_are_documented(
    described: Any, known: Known, method: str, path: str, mode: GenerationMode
) -> None:
    sent(described, known, method, path, mode, MORE)


@pytest.mark.slow
@pytest.mark.parametrize("mode", GenerationMode, ids=lambda mode: mode.value)
@pytest.mark.parametrize(("method", "path"), OPERATIONS)
def test_the_answers_to_many_requests_are_documented(
    described: Any, known: Known, method: str, path: str, mode: GenerationMode
) -> None:
    sent(described, known, method, path, mode, MANY)


@pytest.mark.parametrize(("method", "path"), OPERATIONS)
def test_every_answer_is_documented_if_keys_are_required(
    guarded: tuple[Any, ScopeKeys], method: str, path: str
) -> None:
    """Requests are sent without a key, with an invalid one, and with one of each scope."""
    described, ring = guarded
    cases = described[path][method].as_strategy(generation_mode=GenerationMode.POSITIVE)
    shown = st.sampled_from([None, "wrong", *ring.keys.values()])

    @seed(SEED)
    @settings(
        max_examples=WITH_KEYS,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
    )
    @given(case=cases, data=st.data(), key=shown)
    def answers(case: Any, data: st.DataObject, key: str | None) -> None:
        aim(case, data, {})
        case.headers = {
            name: value for name, value in case.headers.items() if name.lower() != "authorization"
        }
        more = {} if key is None else {"Authorization": f"Bearer {key}"}
        without = excluded(method, path, keys=True)
        response = case.call(headers=more, timeout=ANSWER_S)
        if response.status_code == TOO_LARGE:  # refused before it was validated
            without.append(negative_data_rejection)
        case.validate_response(response, excluded_checks=without, headers=more)
        # A client that signs in sends a key or a password in the body.
        signs_in = (method, path) == ("post", "/api/v1/session")
        assert (response.status_code == 401) <= (key in (None, "wrong") or signs_in)

    answers()
