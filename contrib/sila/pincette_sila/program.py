"""SiLA 2 server of one rig. It can start before its supervisor, and reports that it waits for the
supervisor.
"""

import logging
import os
import uuid
from pathlib import Path

from sila2.features.authenticationservice import AuthenticationServiceFeature
from sila2.features.authorizationservice import AuthorizationServiceFeature
from sila2.features.lockcontroller import LockControllerFeature
from sila2.framework import Feature
from sila2.server import FeatureImplementationBase, SilaServer

from pincette import __version__
from pincette.core.files import make_folder, replace_file
from pincette.engine.program import Context, require_port
from pincette_sila.background import Background
from pincette_sila.callers import Authentication, Authorization, Callers
from pincette_sila.controllers import Cancelling, Pausing, Simulation
from pincette_sila.features import (
    CANCEL_CONTROLLER,
    ERROR_RECOVERY,
    MICROGRIPPER,
    PAUSE_CONTROLLER,
    SECOND_ARM,
    SIMULATION_CONTROLLER,
    command,
    feature,
)
from pincette_sila.gripper import Gripper, moving_commands
from pincette_sila.lock import Lock
from pincette_sila.recovery import ErrorRecovery
from pincette_sila.second_arm import SecondArm
from pincette_sila.subscriptions import install
from pincette_sila.watching import watch_rig, watch_samples

KEY = "PINCETTE_KEY"
"""Environment variable with the key for a supervisor that requires one."""
VENDOR = "https://pincette.invalid"
IDENTITY = "sila-server-uuid"
"""File in the data folder that stores the server's UUID."""


def run(context: Context) -> None:
    """Serve until the program is stopped."""
    install()
    settings, rig = context.rig.sila, context.rig.rig.name
    background = Background()
    url, pki = settings.supervisor or context.rig.supervisor.url, context.rig.bus.pki
    authority = None if pki is None else Path(pki) / "authority.crt"
    callers = Callers(url, rig, os.environ.get(KEY) or None, authority, background)
    server = SilaServer(
        server_name=f"pincette {rig}",
        server_type="PiezoMicrogripper",
        server_description=f"Piezoelectric microgripper {rig}: position and force control",
        server_version=__version__,
        server_vendor_url=VENDOR,
        server_uuid=identity(context.data / f"{IDENTITY}-{rig}"),
    )
    recovery = ErrorRecovery(server, callers, background)
    gripper = Gripper(server, rig, callers, background, recovery)
    pausing = Pausing(server, gripper, callers, background)
    moving = [
        *moving_commands(),
        command("Resume", PAUSE_CONTROLLER),
        command("ExecuteContinuationOption", ERROR_RECOVERY),
    ]
    features: list[tuple[Feature, FeatureImplementationBase]] = [
        (feature(MICROGRIPPER), gripper),
        (feature(CANCEL_CONTROLLER), Cancelling(server, gripper, callers, background)),
        (feature(PAUSE_CONTROLLER), pausing),
        (feature(ERROR_RECOVERY), recovery),
        (
            feature(SIMULATION_CONTROLLER),
            Simulation(server, simulated=context.rig.simulation is not None),
        ),
        (LockControllerFeature, Lock(server, moving)),
    ]
    second = None
    if context.rig.second is not None:
        second = SecondArm(server)
        features.append((feature(SECOND_ARM), second))
    if settings.login:
        wants_token = [*moving, command("Plan")]
        features.append((AuthenticationServiceFeature, Authentication(server, callers)))
        features.append((AuthorizationServiceFeature, Authorization(server, callers, wants_token)))
    for one, implementation in features:
        server.set_feature_implementation(one, implementation)
    _quieten()
    _listen(server, context)
    background.begin(watch_rig(server, gripper, callers, pausing))
    background.begin(watch_samples(gripper, callers, second))
    try:
        context.ready(f"SiLA 2 at {settings.host}:{settings.port}, for the supervisor at {url}")
        context.stop.wait()
    finally:
        background.close()
        server.stop(grace_period=1.0)


def identity(path: Path) -> uuid.UUID:
    """Return the UUID stored in a file, which is created if it does not exist."""
    try:
        return uuid.UUID(path.read_text(encoding="ascii").strip())
    except FileNotFoundError:
        make_folder(path.parent)
        found = uuid.uuid4()
        replace_file(path, f"{found}\n".encode("ascii"))
        return found


def _listen(server: SilaServer, context: Context) -> None:
    settings = context.rig.sila
    where = (settings.host, settings.port)
    require_port(*where, "[sila]")  # report why the port cannot be opened; gRPC does not
    if settings.certificate is None:
        server.start_insecure(*where, enable_discovery=settings.discovery)
        return
    certificate = Path(settings.certificate)
    server.start(
        *where,
        private_key=certificate.with_suffix(".key").read_bytes(),
        cert_chain=certificate.read_bytes(),
        enable_discovery=settings.discovery,
    )


class _Quiet(logging.Filter):
    """Log filter that drops messages of sila2, which logs each call, and each rejection with a
    stack trace.
    """

    def filter(self, record: logging.LogRecord) -> bool:
        return record.name.startswith("pincette") or not record.pathname.partition("sila2")[1]


def _quieten() -> None:
    logging.getLogger("httpx").setLevel(logging.WARNING)
    for handler in logging.getLogger().handlers:
        handler.addFilter(_Quiet())
