"""One job from its preparation to its end, in a thread of its own; never inside the loop."""

import secrets
from collections.abc import Callable

from pincette.api.request_models import AnyJobRequest
from pincette.bus.protocol import BusError, RefusalError
from pincette.messages import Act
from pincette.runtime.arming import arm
from pincette.topics import ACT
from pincette_supervisor.journal.store import StoreError
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.running import deadlines
from pincette_supervisor.running.job import LiveJob
from pincette_supervisor.running.keeping import Keeper
from pincette_supervisor.running.lease import Renewal, lease_of, renewing
from pincette_supervisor.running.part import held_words, plays, reset_words
from pincette_supervisor.running.site import Site
from pincette_supervisor.running.watch import Watch

KEEP_S, LOOK_S = 2.0, 0.02
"""How long a program may take to hand its part over."""


class Run:
    """Prepares and arms one job, and has it followed."""

    def __init__(self, site: Site, job: LiveJob, plan: Callable[[AnyJobRequest], Planned]) -> None:
        self._site, self._job, self._plan = site, job, plan

    def main(self) -> None:
        """Live the job; nothing of it moves any more when this returns."""
        job, observer = self._job, self._site.observer
        try:
            planned = self._prepare()
            if planned is None or not self._await_start():
                return
            job.epoch = secrets.randbits(48) | 1
            keeper = Keeper(self._site, job, planned, job.epoch)
            collection = observer.collect()
            if self._arm(planned, keeper):
                with renewing(job.renewal):
                    Watch(self._site, job, planned, keeper, collection).follow()
        except (BusError, ProblemError, StoreError) as error:
            job.end("fail", str(error))
        finally:
            observer.stop_collecting()
            job.end("fail", "the supervisor has a fault; its log says more")

    def _prepare(self) -> Planned | None:
        job = self._job
        job.move("prepare", only_from="queued")
        if job.planned is None and job.state == "preparing":
            job.adopt(self._plan(job.request))
        planned = job.planned
        if planned is not None and job.state == "preparing":
            reasons = self._reasons(planned)
            if reasons:
                job.end("fail", "; ".join(reasons))
                return None
            self._see_deadline(planned)
        if planned is None or not job.move("prepared", only_from="preparing"):
            self._give_up()
            return None
        return planned

    def _reasons(self, planned: Planned) -> list[str]:
        """Why the rig cannot; a latch that means only that it was switched on is cleared."""
        site = self._site
        site.health.refresh(force=True)
        if reasons := site.lasting_reasons():
            return reasons
        site.health.clear_boot()
        if cause := site.health.latched():
            return [reset_words(site, cause)]
        if not planned.begins_held:
            words = held_words(site)
            return [words] if words else []
        return self._take_over()

    def _take_over(self) -> list[str]:
        """End a program that only holds a part, which stays held; why not, where that fails."""
        site = self._site
        if not plays(site):
            return []
        site.bus.ask(ACT, Act("keep"))
        asked_at = site.clock()
        while plays(site):
            if site.clock() - asked_at > KEEP_S:
                return [f"the program that holds the part did not end within {KEEP_S:g} s"]
            self._job.wait(LOOK_S)
        return []

    def _see_deadline(self, planned: Planned) -> None:
        job = self._job
        limit_s = deadlines.limit_s("preparing", planned, planned.model.rig, "hold")
        spent_s = self._site.clock() - job.entered_at
        if limit_s is not None and spent_s > limit_s:
            words = f"preparing took {spent_s:.1f} s, limit {limit_s:g} s"
            if job.move("overdue", words, only_from="preparing"):
                job.end("fail")

    def _await_start(self) -> bool:
        job = self._job
        if job.request.autostart:
            job.move("start", only_from="ready")
        while job.state == "ready" and not job.interrupted:
            job.wait(0.2)
        if job.state == "ready":
            job.end("interrupt", "the supervisor ended")
        return job.state == "running" or self._give_up()

    def _give_up(self) -> bool:
        """End a job that was stopped or aborted before it moved."""
        self._job.end("confirm")
        return False

    def _arm(self, planned: Planned, keeper: Keeper) -> bool:
        site, job, model = self._site, self._job, planned.armed
        row = site.store.get(job.id)
        if row is None:
            return False
        if trouble := keeper.begin(row):
            job.end("fail", f"recorder: {trouble}")
            return False
        job.arm(job.epoch)
        lease = lease_of(planned.model.rig, job.request, job.epoch)
        try:
            arm(
                site.bus,
                planned.program,
                epoch=job.epoch,
                digest=model.rig_file_digest,
                calibration=model.calibration.text(),
                lease=lease,
            )
        except BusError as error:
            keeper.give_up(row)
            # An abort that came while the rig was being armed has latched the actuator.
            ending = isinstance(error, RefusalError) and job.state in ("stopping", "aborting")
            job.end("confirm" if ending else "fail", str(error))
            return False
        if lease is not None:
            job.renewal = Renewal(site.bus, lease)
        site.health.note_armed(job.epoch, model.digest)
        job.acted("start", 0)
        return True
