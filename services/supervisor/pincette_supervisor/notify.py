"""Notices of events, sent by a signed POST (Standard Webhooks 1.0), or by mail over SMTP.

They are sent in order, and repeated until the receiver has accepted them. The journal stores the
number of the last event that a receiver has accepted. A restart loses no notice, and repeats at
most the notice that was being sent.
"""

import base64
import binascii
import hashlib
import hmac
import json
import logging
import os
import re
import smtplib
import ssl
import stat
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from email.message import EmailMessage
from email.policy import SMTP
from ipaddress import ip_address, ip_network
from pathlib import Path
from time import monotonic
from typing import Any, Protocol
from urllib.parse import urlsplit

from pincette.api.events import Event
from pincette.api.states import STATES
from pincette.config.notify import Mail, Told, Webhook
from pincette.config.programs import Supervisor
from pincette.core.files import EncodingError, decoded
from pincette.engine.threads import RepeatedAction
from pincette_supervisor.access.access import DEFAULT_PORTS, is_loopback
from pincette_supervisor.jobs.proposals import approval_until
from pincette_supervisor.journal.store import Store
from pincette_supervisor.journal.tables import JobRow

# Notice of an event of the journal; pure.

ALARMS: Mapping[str, Told] = {"raised": "alarm.raised", "cleared": "alarm.cleared"}
MEMBERS: Mapping[Told, tuple[str, ...]] = {
    "job.proposed": ("state",),
    "job.ended": ("state", "ending", "cause"),
    "job.recorded": ("complete", "detail"),
}
"""Members of an event of a job that its notice contains, by topic."""
SAID = (
    *("kind", "sample", "batch", "operator"),
    *("requested_by", "traceparent", "started_at", "ended_at"),
)
"""Members of a job that are included in the notice of its end."""


@dataclass(frozen=True, slots=True)
class Notice:
    """A notice to be sent."""

    number: int
    """Unique number of the event, by which a receiver recognises repetitions."""
    type: Told
    at: str
    title: str
    """One-line summary for people."""
    data: dict[str, Any]

    @property
    def body(self) -> dict[str, Any]:
        """Return the payload of a webhook."""
        return {"type": self.type, "timestamp": self.at, "data": {"title": self.title, **self.data}}


def topic_of(event: Event) -> Told | None:
    """Return the topic under which an event is reported; None: it is not reported."""
    if event.kind == "state":
        state = event.body["state"]
        if state == "proposed":
            return "job.proposed"
        return "job.ended" if STATES[state].terminal else None
    if event.kind == "record":
        return "job.recorded"
    if event.kind != "alarm":
        return None
    topic = ALARMS.get(str(event.body.get("did")))
    # An alarm that is counted again while it is open has already been reported.
    again = topic == "alarm.raised" and event.body.get("alarm", {}).get("count", 1) > 1
    return None if again else topic


def notice_of(event: Event, job: JobRow | None) -> Notice | None:
    """Return the notice of an event; ``job`` is the job of the event, or None."""
    topic = topic_of(event)
    if topic is None or event.number is None:
        return None
    body = event.body
    data: dict[str, Any] = {"event": event.number, "rig": event.rig, "job": event.job}
    if topic in MEMBERS:
        data |= {name: body.get(name) for name in MEMBERS[topic]}
        if job is not None:
            data |= {name: getattr(job, name) for name in SAID}
        on = f" on {data['sample']}" if data.get("sample") else ""
        state = str(body.get("state", "its record is written"))
        if topic == "job.proposed" and job is not None:
            data["approval_until"] = approval_until(job)
            state = f"proposed by {job.requested_by}"
        title = f"{data.get('kind', 'job')} {event.job}{on}: {state}"
        title += f", {body['cause']}" if body.get("cause") else ""
    else:
        alarm = body.get("alarm", {})
        data |= {name: body.get(name) for name in ("cause", "words")}
        data |= {"alarm": alarm.get("id"), "severity": alarm.get("severity")}
        how = "over" if topic == "alarm.cleared" else data["severity"] or "alarm"
        title = f"{how}: {body.get('words')}"
    return Notice(event.number, topic, event.at, f"{event.rig}: {title}", data)


# Reasons for which a notice has not been accepted.


class RefusedError(Exception):
    """A receiver has rejected a notice; the text states why. The notice is sent again later."""


class NotWantedError(Exception):
    """A receiver accepts no more notices."""


# The certificate authorities by which receivers of notices are verified.

FILE, FOLDER = "SSL_CERT_FILE", "SSL_CERT_DIR"
"""Environment variables that name a file, and folders, of trusted certificate authorities."""
HASHED = re.compile(r"[0-9a-f]{8}\.\d+")
"""Pattern of the file names under which OpenSSL looks for certificates in a folder."""
UNKNOWN_ISSUER = (18, 19, 20, 21)
"""OpenSSL error codes that mean that no trusted authority has signed a certificate."""
REMEDY = (
    f"if its certificate comes from a private authority, set {FILE} in the supervisor's environment"
)


def trusted() -> ssl.SSLContext:
    """Return TLS settings that trust the configured authorities, or the system's if none is
    configured.

    Raises RefusedError if the configured ones cannot be read.
    """
    context = ssl.create_default_context()
    file, folders = os.environ.get(FILE), os.environ.get(FOLDER)
    if file:
        try:
            context.load_verify_locations(cafile=file)
        except OSError as error:
            raise RefusedError(
                f"{FILE}={file} has no certificate that can be read ({error.strerror or error}): "
                "name a file in PEM format"
            ) from error
    for folder in (folders or "").split(os.pathsep):
        if folder:
            _check(Path(folder))
    if not file and not folders:
        import certifi

        context.load_verify_locations(cafile=certifi.where())
    return context


def _check(folder: Path) -> None:
    try:
        hashed = any(HASHED.fullmatch(place.name) for place in folder.iterdir())
    except OSError as error:
        raise RefusedError(f"{FOLDER}={folder} cannot be read: {error.strerror}") from error
    if not hashed:
        raise RefusedError(
            f"{FOLDER}={folder} has no certificate under a hashed name, as OpenSSL needs: "
            f"run openssl rehash {folder}"
        )


# Selection of a forward proxy for an address from environment variables; pure. httpx reads the same
# variables, but treats a network in ``NO_PROXY`` (10.0.0.0/8) as its first address, and rejects
# every request if a network is written as fd00::/8.


@dataclass(frozen=True, slots=True)
class Proxy:
    """A forward proxy."""

    url: str
    """Address with a scheme; it may contain a user name and a password."""
    variable: str
    """Name of the environment variable that sets the proxy."""

    @property
    def over_tls(self) -> bool:
        """Return True if the connection to the proxy itself uses TLS."""
        return self.url.lower().startswith("https:")

    def __str__(self) -> str:
        """Return the address of the proxy, without name and password."""
        return f"the proxy {self.url.rpartition('@')[2].rpartition('//')[2]} ({self.variable})"


def proxy_of(url: str, environment: Mapping[str, str]) -> Proxy | None:
    """Return the proxy for an address, or None for a direct connection; raises ValueError."""
    place = urlsplit(url)
    host = (place.hostname or "").rstrip(".")
    # A proxy cannot reach a program of this machine by a loopback address.
    if is_loopback(host):
        return None
    names = environment.get("no_proxy") or environment.get("NO_PROXY") or ""
    port = place.port or DEFAULT_PORTS[place.scheme]
    if any(_covers(entry.strip().lower(), host, port) for entry in names.split(",")):
        return None
    for scheme in (place.scheme, "all"):
        for variable in (f"{scheme}_proxy", f"{scheme}_proxy".upper()):
            if found := environment.get(variable, "").strip():
                return Proxy(found if "://" in found else f"http://{found}", variable)
    return None


def _covers(entry: str, host: str, port: int) -> bool:
    """Return whether an entry of ``NO_PROXY`` (name, suffix, address, network; port) matches.

    An entry that cannot be parsed matches nothing.
    """
    if entry in ("", "*"):
        return entry == "*"
    with suppress(ValueError):
        return ip_address(host) in ip_network(entry.strip("[]"), strict=False)
    name, colon, wanted = entry.rpartition(":")
    if colon and wanted.isdecimal():
        if int(wanted) != port:
            return False
        return _covers(name, host, port)
    suffix = entry.removeprefix("*").lstrip(".")
    return bool(suffix) and (host == suffix or host.endswith(f".{suffix}"))


# Delivery of notices to a receiver.

PREFIX = "whsec_"
SECRET_BYTES = (24, 64)
TIMEOUT_S = 15.0
GONE = 410
"""HTTP status by which a receiver rejects all further notices."""


class SecretError(OSError):
    """A file with a secret cannot be used; the text states the file and the remedy."""


class Sender(Protocol):
    """Transport of notices to one receiver."""

    @property
    def name(self) -> str:
        """Return the name under which the journal stores the progress of the receiver."""
        ...

    @property
    def events(self) -> tuple[Told, ...]:
        """Return the topics that are sent to the receiver."""
        ...

    def send(self, notice: Notice) -> None:
        """Send a notice; raises RefusedError if it may be retried, and NotWantedError otherwise."""
        ...


def read_secret(path: Path) -> str:
    """Return the secret of a file that only its owner can read; raises SecretError."""
    try:
        mode, text = path.stat().st_mode, decoded(path.read_bytes()).strip()
    except (OSError, EncodingError) as error:
        raise SecretError(f"the secret {path} cannot be read: {error}") from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise SecretError(f"others may read the secret {path}: chmod 600 {path}")
    if not text:
        raise SecretError(f"the secret {path} is empty: write the secret into it")
    return text


def signature(secret: bytes, message: str, sent_s: int, body: bytes) -> str:
    """Return the HMAC-SHA256 of ``id.timestamp.body`` in base64, as in Standard Webhooks."""
    signed = f"{message}.{sent_s}.".encode() + body
    return "v1," + base64.b64encode(hmac.digest(secret, signed, hashlib.sha256)).decode()


class WebhookSender:
    """Posts notices to an address."""

    def __init__(self, webhook: Webhook, secret: str) -> None:
        self._url, self.events = webhook.url, webhook.events
        self.name = f"webhook {webhook.url}"
        try:
            self._secret = base64.b64decode(secret.removeprefix(PREFIX), validate=True)
        except binascii.Error as error:
            raise SecretError(f"the secret of {self.name} is not base64: {error}") from error
        least, most = SECRET_BYTES
        if not secret.startswith(PREFIX) or not least <= len(self._secret) <= most:
            raise SecretError(
                f"the secret of {self.name} must be {PREFIX} followed by {least} to {most} "
                "bytes in base64"
            )

    def send(self, notice: Notice) -> None:
        """Post a notice, with the same id in each attempt."""
        body = json.dumps(notice.body, ensure_ascii=False, separators=(",", ":")).encode()
        message, sent_s = f"msg_{notice.data['rig']}_{notice.number}", int(time.time())
        headers = {
            "Content-Type": "application/json",
            "User-Agent": "pincette",
            "webhook-id": message,
            "webhook-timestamp": str(sent_s),
            "webhook-signature": signature(self._secret, message, sent_s, body),
        }
        status = post(self._url, body, headers)
        if status == GONE:
            raise NotWantedError(f"status {GONE}")
        if not 200 <= status < 300:
            raise RefusedError(f"status {status}")


def post(url: str, body: bytes, headers: dict[str, str]) -> int:
    """Post a body through the proxy of the environment, and return the status.

    Raises RefusedError.
    """
    # Most supervisors post nothing, and importing httpx takes a tenth of their start.
    import httpx

    context = trusted()
    place = ""
    try:
        proxy = proxy_of(url, os.environ)
        place = f"through {proxy}: " if proxy else ""
        settings: dict[str, Any] = {}
        if proxy:
            tls = context if proxy.over_tls else None
            settings["proxy"] = httpx.Proxy(proxy.url, ssl_context=tls)
        with httpx.Client(timeout=TIMEOUT_S, verify=context, trust_env=False, **settings) as client:
            return client.post(url, content=body, headers=headers).status_code
    except (httpx.HTTPError, httpx.InvalidURL, ValueError, ImportError) as error:
        raise RefusedError(place + _reason(error)) from error


def _reason(error: Exception) -> str:
    """Return why a receiver could not be reached, with the remedy if its certificate's issuer is
    not trusted."""
    reason = str(error) or type(error).__name__
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, ssl.SSLCertVerificationError):
        cause = cause.__cause__ or cause.__context__
    unknown = cause is not None and cause.verify_code in UNKNOWN_ISSUER
    return f"{reason}: {REMEDY}" if unknown else reason


class MailSender:
    """Mails notices through an SMTP server."""

    def __init__(self, mail: Mail, password: str) -> None:
        self._mail, self._password, self.events = mail, password, mail.events
        self.name = f"mail {mail.host}:{mail.port} {','.join(mail.to)}"

    def message(self, notice: Notice) -> EmailMessage:
        """Return a notice as a mail; its Message-ID is the same in each attempt."""
        mail = self._mail
        message = EmailMessage(policy=SMTP)
        message["From"], message["To"] = mail.sender, ", ".join(mail.to)
        message["Subject"] = " ".join(f"[pincette] {notice.title}"[:200].split())
        domain = mail.sender.rpartition("@")[2]
        message["Message-ID"] = f"<{notice.data['rig']}.{notice.number}@{domain}>"
        message["Auto-Submitted"] = "auto-generated"
        details = [f"{name}: {value}" for name, value in notice.data.items() if value is not None]
        message.set_content("\n".join([notice.title, "", f"at: {notice.at}", *details]) + "\n")
        return message

    def send(self, notice: Notice) -> None:
        """Hand a notice as a mail over to the server."""
        mail = self._mail
        try:
            with self._opened() as server:
                if mail.security == "starttls":
                    server.starttls(context=trusted())
                if mail.user:
                    server.login(mail.user, self._password)
                server.send_message(self.message(notice))
        except (OSError, smtplib.SMTPException) as error:
            raise RefusedError(_reason(error)) from error

    def _opened(self) -> smtplib.SMTP:
        host, port = self._mail.host, self._mail.port
        if self._mail.security == "tls":
            return smtplib.SMTP_SSL(host, port, timeout=TIMEOUT_S, context=trusted())
        return smtplib.SMTP(host, port, timeout=TIMEOUT_S)


def senders_of(supervisor: Supervisor, data: Path) -> list[Sender]:
    """Return the senders of a rig file; raises SecretError."""
    found: list[Sender] = [
        WebhookSender(webhook, read_secret(data / webhook.secret_file))
        for webhook in supervisor.webhooks
    ]
    if supervisor.mail is not None:
        file = supervisor.mail.password_file
        found.append(MailSender(supervisor.mail, read_secret(data / file) if file else ""))
    return found


LOOK_S = 1.0
FIRST_DELAY_S, LONGEST_DELAY_S = 5.0, 300.0
"""Delay between the first two attempts, in s, and the longest delay; the delay doubles with each
attempt.
"""
GIVEN_UP_S = 3 * 86_400.0
"""Time after which a notice that is still rejected is skipped, in s."""
PAGE = 200
STOP_S = 2.0

log = logging.getLogger("pincette")


class Delivery:
    """State of one receiver: the last delivered notice, and the time of the next attempt."""

    def __init__(
        self, store: Store, sender: Sender, clock: Callable[[], float] = monotonic
    ) -> None:
        self._store, self._sender, self._clock = store, sender, clock
        self._note = f"told {sender.name}"  # earlier versions used this name
        self._delay_s = FIRST_DELAY_S
        self._again_at = 0.0
        self._begun = self._ended = False
        self._refused_since: float | None = None
        """Time of the first rejection of the notice that is being sent; None if it was not
        rejected."""

    def begin(self) -> None:
        """Begin with the next event for an unknown receiver; raises StoreError."""
        _, newest = self._store.event_span()
        known = self._store.get_note(self._note)
        if known is None or int(known) > newest:
            self._store.set_note(self._note, str(newest))
        self._begun = True

    def work(self) -> None:
        """Send the pending notices until the receiver rejects one; raises StoreError."""
        if not self._begun:
            self.begin()
        if self._ended or self._clock() < self._again_at:
            return
        number = int(self._store.get_note(self._note) or 0)
        while events := self._store.events_after(number, limit=PAGE):
            for event in events:
                assert event.number is not None
                if topic_of(event) in self._sender.events:
                    job = None if event.job is None else self._store.get(event.job)
                    notice = notice_of(event, job)
                    if notice is not None and not self._sent(notice):
                        return
                    self._store.set_note(self._note, str(event.number))
                number = event.number
            self._store.set_note(self._note, str(number))

    def _sent(self, notice: Notice) -> bool:
        """Send one notice; return True if no further attempt is needed."""
        try:
            self._sender.send(notice)
        except NotWantedError as error:
            log.warning("%s accepts no more notices: %s", self._sender.name, error)
            self._ended = True
            return False
        except RefusedError as error:
            # Measured by the monotonic clock: a step of the time of day must not cause the loss of
            # a notice.
            if self._refused_since is None:
                self._refused_since = self._clock()
            if self._clock() - self._refused_since > GIVEN_UP_S:
                log.error("%s: gave up after days of refusals: %s", self._sender.name, error)
                self._refused_since = None
                return True
            log.warning("%s: %s; next attempt in %g s", self._sender.name, error, self._delay_s)
            self._again_at = self._clock() + self._delay_s
            self._delay_s = min(2.0 * self._delay_s, LONGEST_DELAY_S)
            return False
        self._delay_s = FIRST_DELAY_S
        self._refused_since = None
        return True


class Outbox:
    """Threads of the receivers, one for each, so that no receiver waits for another."""

    def __init__(self, store: Store, senders: Sequence[Sender]) -> None:
        self._threads: list[RepeatedAction] = []
        for sender in senders:
            delivery = Delivery(store, sender)
            # A daemon thread: a receiver that does not reply must not delay the end of the program.
            thread = RepeatedAction(f"notices to {sender.name}", LOOK_S, delivery.work)
            thread.run(delivery.begin)
            thread.start()
            self._threads.append(thread)

    def close(self) -> None:
        """Stop the threads; pending notices are sent after the next start."""
        for thread in self._threads:
            thread.close(STOP_S)
