"""Named checks of a rig and of the supervisor, from what is known; asks nobody."""

from collections.abc import Iterator
from datetime import UTC, datetime

from pincette.api.check_models import Check
from pincette.messages import Status
from pincette.topics import ESTIMATE, POSITION, TELEMETRY
from pincette_supervisor.journal.store import Store
from pincette_supervisor.running.alarm_rules import free_on
from pincette_supervisor.running.health import PROGRAMS
from pincette_supervisor.running.job import LiveJob
from pincette_supervisor.running.part import plays
from pincette_supervisor.running.site import Site

SPEAKS = {"estimator": ESTIMATE, "controller": TELEMETRY}
"""Programs whose samples come while a program plays."""


def of_supervisor(store: Store) -> list[Check]:
    """What every rig needs of the supervisor itself."""
    words = store.trouble or "the journal can be written"
    value = "failed" if store.trouble else "written"
    return [_check("store", not store.trouble, words, value=value, limit="written")]


def of_rig(site: Site, active: LiveJob | None) -> list[Check]:
    """Everything that is looked at of a rig, in the order of a tick."""
    return [
        *_answers(site),
        *_ages(site),
        _latch(site),
        _disk(site),
        _recorder(site),
        _lease(site, active),
        *_model(site),
    ]


def words_of(checks: list[Check]) -> list[str]:
    """What is needed and missing."""
    return [check.words for check in checks if check.needed and not check.ok]


def _check(name: str, ok: bool, words: str, *, needed: bool = True, **known: object) -> Check:
    base = {"value": None, "limit": None, "unit": "", "age_s": 0.0}
    return Check.model_validate(
        {"name": name, "ok": ok, "needed": needed, "words": words, **base, **known}
    )


def _answers(site: Site) -> Iterator[Check]:
    """Whether each program answers, and works with the same rig file."""
    health = site.health
    troubles = health.troubles()
    for program in PROGRAMS:
        answer = health.statuses.get(program)
        trouble = troubles.get(program, "")
        if program == "sensor" and isinstance(answer, Status) and trouble == _sensor(site):
            trouble = ""  # of its samples, not of its answer
        if isinstance(answer, Status) and not trouble:
            words = f"{program} answers, version {answer.version}"
        else:
            words = f"{program}: {trouble or 'was not asked yet'}"
        yield _check(
            f"{program}.answer",
            isinstance(answer, Status) and not trouble,
            words,
            value=answer.digest if isinstance(answer, Status) else None,
            limit=site.digest,
            age_s=health.asked_age_s,
        )


def _ages(site: Site) -> Iterator[Check]:
    """In real time, how old the newest samples are; the sensor's always, others' in a program."""
    if site.rig.lockstep:
        return
    limit_s = site.health.sensor_limit_s()
    age_s = site.observer.silent_s(POSITION)
    trouble = _sensor(site)
    words = f"sensor: {trouble}" if trouble else "the sensor's samples come"
    yield _check("sensor.age", not trouble, words, value=age_s, limit=limit_s, unit="s")
    for program, topic in SPEAKS.items() if plays(site) else ():
        age_s = site.observer.silent_s(topic)
        ok = age_s is not None and age_s <= limit_s
        words = f"the {program}'s samples come"
        if age_s is None:
            words = f"{program}: no sample has come yet"
        elif not ok:
            words = f"{program}: silent for {1e3 * age_s:.0f} ms, limit {1e3 * limit_s:.0f} ms"
        yield _check(
            f"{program}.age", ok, words, needed=False, value=age_s, limit=limit_s, unit="s"
        )


def _sensor(site: Site) -> str:
    return "" if site.rig.lockstep else site.health.sensor_trouble()


def _latch(site: Site) -> Check:
    """A latched actuator is well, and waits for a person."""
    latched = site.health.latched()
    words = f"actuator latched ({site.trip_words(latched)})" if latched else "no latch to clear"
    return _check(
        "actuator.latch",
        not latched,
        words,
        needed=False,
        value=site.health.latch()[0],
        limit="clear",
    )


def _disk(site: Site) -> Check:
    free_MB, limit_MB = free_on(site.records), site.rig.recorder.min_free_MB
    ok = free_MB is None or free_MB >= limit_MB
    shown = "room is not known" if free_MB is None else f"{free_MB:.0f} MB free"
    words = f"disk of the records: {shown}, limit {limit_MB:g} MB"
    return _check("disk", ok, words, needed=False, value=free_MB, limit=limit_MB, unit="MB")


def _recorder(site: Site) -> Check:
    answer = site.health.statuses.get("recorder")
    lost = answer.missed if isinstance(answer, Status) else None
    words = "recorder does not answer"
    if isinstance(answer, Status):
        words = f"recorder: {answer.detail or 'idle'}; {lost} messages lost"
    return _check(
        "recorder.lost", lost == 0, words, needed=False, value=lost, limit=0, unit="messages"
    )


def _lease(site: Site, active: LiveJob | None) -> Check:
    renewal = None if active is None else active.renewal
    if renewal is None:
        limit_s = site.rig.safety.lease_s if not site.rig.lockstep else 0.0
        return _check("lease", True, "no program plays under a lease", limit=limit_s, unit="s")
    age_s, limit_s = renewal.age_s, renewal.lease.length_s
    words = f"lease renewed {age_s:.1f} s ago, limit {limit_s:g} s"
    return _check("lease", age_s <= limit_s, words, value=age_s, limit=limit_s, unit="s")


def _model(site: Site) -> Iterator[Check]:
    warnings = site.model.warnings(datetime.now(UTC))
    words = "; ".join(warnings) or "no calibration is due"
    yield _check("model.due", not warnings, words, needed=False, value=len(warnings), limit=0)
    if site.model.trouble:
        yield _check("model", False, site.model.trouble)
