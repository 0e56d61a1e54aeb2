"""Webhooks and mail at ends of jobs and alarms: signed, retried, kept over a restart."""

import base64
import email
import email.policy
import hashlib
import hmac
import json
from pathlib import Path
from typing import Any

import pytest

from pincette.config.notify import Mail, Webhook
from pincette.config.programs import Supervisor
from pincette_supervisor.journal.events import EventLog
from pincette_supervisor.journal.store import Store
from pincette_supervisor.notify import (
    FIRST_DELAY_S,
    Delivery,
    MailSender,
    Outbox,
    SecretError,
    Sender,
    WebhookSender,
    senders_of,
)
from tests.support.receivers import Received, http_receiver, smtp_receiver

from .harness import Harness

RAW = bytes(range(32))
SECRET = "whsec_" + base64.b64encode(RAW).decode()


def webhook(received: Received, **more: Any) -> WebhookSender:
    return WebhookSender(
        Webhook(url=f"http://127.0.0.1:{received.port}/hook", secret_file="s", **more), SECRET
    )


def mail(received: Received) -> MailSender:
    to = ("ann@laboratory.example", "ben@laboratory.example")
    sender = "rig@laboratory.example"
    return MailSender(
        Mail(host="127.0.0.1", port=received.port, security="none", sender=sender, to=to), ""
    )


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def deliver(store: Store, sender: Sender) -> tuple[Delivery, Clock]:
    clock = Clock()
    delivery = Delivery(store, sender, clock)
    delivery.begin()
    return delivery, clock


def ended(harness: Harness) -> str:
    job = harness.grip(sample="B7 Größe")["id"]
    harness.ended(job)
    harness.freed(job)
    return str(job)


def test_the_end_of_a_job_is_posted_and_its_signature_holds(harness: Harness) -> None:
    with http_receiver() as received:
        delivery, _ = deliver(harness.store, webhook(received))
        job = ended(harness)
        delivery.work()
    ((headers, body),) = received.posts
    content = json.loads(body)
    assert (content["type"], content["data"]["job"], content["data"]["state"]) == (
        "job.ended",
        job,
        "succeeded",
    )
    assert content["data"]["sample"] == "B7 Größe"
    # As the standard specifies it, and not as the product computes it.
    signed = f"{headers['webhook-id']}.{headers['webhook-timestamp']}.".encode() + body
    mac = hmac.new(RAW, signed, hashlib.sha256).digest()
    assert headers["webhook-signature"] == f"v1,{base64.b64encode(mac).decode()}"
    assert headers["content-type"] == "application/json"


def test_a_rejected_notice_is_sent_again_with_the_same_id(harness: Harness) -> None:
    with http_receiver([500, 503]) as received:
        delivery, clock = deliver(harness.store, webhook(received))
        ended(harness)
        delivery.work()
        delivery.work()
        assert len(received.posts) == 1  # it waits
        clock.now_s += FIRST_DELAY_S
        delivery.work()
        clock.now_s += FIRST_DELAY_S
        delivery.work()
        assert len(received.posts) == 2  # twice as long
        clock.now_s += FIRST_DELAY_S
        delivery.work()
        delivery.work()
    assert len(received.posts) == 3
    assert len({headers["webhook-id"] for headers, _ in received.posts}) == 1


def test_a_restart_loses_no_notice_and_sends_none_twice(harness: Harness) -> None:
    with http_receiver() as received:
        delivery, _ = deliver(harness.store, webhook(received))
        first = ended(harness)
        delivery.work()
        second = ended(harness)  # the supervisor ends before it is notified
        again, _ = deliver(harness.store, webhook(received))
        again.work()
        again.work()
    jobs = [json.loads(body)["data"]["job"] for _, body in received.posts]
    assert jobs == [first, second]


def test_a_removed_receiver_gets_no_more_notices(harness: Harness) -> None:
    with http_receiver([410]) as received:
        delivery, clock = deliver(harness.store, webhook(received))
        ended(harness)
        delivery.work()
        clock.now_s += 1e4
        delivery.work()
    assert len(received.posts) == 1


def test_a_proposed_job_is_notified_with_its_time_limit(harness: Harness) -> None:
    body = {"kind": "grip", "autostart": True, "approval_s": 600.0, "sample": "bead 7"}
    with http_receiver() as received, http_receiver() as others:
        proposals, _ = deliver(harness.store, webhook(received, events=("job.proposed",)))
        usual, _ = deliver(harness.store, webhook(others))
        job = harness.post("/jobs", body).json()
        proposals.work()
        usual.work()
    ((_, content),) = received.posts
    notice = json.loads(content)
    assert (notice["type"], notice["data"]["job"]) == ("job.proposed", job["id"])
    assert notice["data"]["approval_until"] == job["approval_until"]
    assert (notice["data"]["state"], notice["data"]["sample"]) == ("proposed", "bead 7")
    assert others.posts == []


def test_an_alarm_is_notified_once_and_its_end_only_on_request(harness: Harness) -> None:
    alarms = harness.manager.context.alarms
    with http_receiver() as received, http_receiver() as all_of_it:
        usual, _ = deliver(harness.store, webhook(received))
        every, _ = deliver(
            harness.store, webhook(all_of_it, events=("alarm.raised", "alarm.cleared"))
        )
        for _ in range(3):
            alarms.raise_alarm("disk", "only 12 MB are free")
        alarms.clear("disk", "there is room")
        usual.work()
        every.work()
    (reported,) = [json.loads(body) for _, body in received.posts]
    assert (reported["type"], reported["data"]["cause"]) == ("alarm.raised", "disk")
    types = [json.loads(body)["type"] for _, body in all_of_it.posts]
    assert types == ["alarm.raised", "alarm.cleared"]


def test_a_mail_states_what_ended_and_is_retried(harness: Harness) -> None:
    with smtp_receiver(refusals=1) as received:
        delivery, clock = deliver(harness.store, mail(received))
        job = ended(harness)
        delivery.work()
        assert received.mails == []
        clock.now_s += FIRST_DELAY_S
        delivery.work()
    ((sender, to, content),) = received.mails
    assert sender == "rig@laboratory.example"
    assert to == ["ann@laboratory.example", "ben@laboratory.example"]
    message = email.message_from_bytes(content, policy=email.policy.default)
    assert message["Subject"] == f"[pincette] demo: grip {job} on B7 Größe: succeeded"
    body = message.get_body()
    assert body is not None
    assert f"job: {job}" in body.get_content()


def test_the_supervisor_sends_notices_by_itself(harness: Harness) -> None:
    with http_receiver() as received:
        outbox = Outbox(harness.store, [webhook(received)])
        EventLog(harness.store, "demo").append("queue", action="clear")
        case = f"told {webhook(received).name}"
        harness.until(lambda: harness.store.get_note(case) is not None)
        job = ended(harness)
        harness.until(lambda: len(received.posts) == 1)
        outbox.close()
    assert json.loads(received.posts[0][1])["data"]["job"] == job


def test_a_secret_is_readable_by_its_owner_only(tmp_path: Path) -> None:
    path = tmp_path / "secret"
    rig = Supervisor(webhooks=(Webhook(url="http://localhost/", secret_file="secret"),))
    with pytest.raises(SecretError, match="cannot be read"):
        senders_of(rig, tmp_path)
    path.write_text(SECRET)
    path.chmod(0o644)
    with pytest.raises(SecretError, match="chmod 600"):
        senders_of(rig, tmp_path)
    path.chmod(0o600)
    assert [sender.name for sender in senders_of(rig, tmp_path)] == ["webhook http://localhost/"]
    for weak in ("whsec_c2hvcnQ=", "c" * 40, "whsec_%%%"):
        path.write_text(weak)
        with pytest.raises(SecretError):
            senders_of(rig, tmp_path)
