"""A job of a supervisor."""

from collections.abc import Iterator
from pathlib import Path

from pincette.api.event_models import Event
from pincette.api.job_models import Artifact, Job
from pincette.api.states import ActionType, JobState
from pincette.client import job_calls
from pincette.client.errors import WaitTimeoutError
from pincette.client.kinds import AnyResult, result_of
from pincette.client.landing import Landing
from pincette.client.line import Line


class JobHandle:
    """One job: how it is, what it shall do, what came of it."""

    def __init__(self, line: Line, job: Job) -> None:
        self._line = line
        self.job = job
        """As it was when the supervisor last spoke of it."""

    @property
    def id(self) -> str:
        """Its name."""
        return self.job.id

    @property
    def state(self) -> JobState:
        """As of the newest answer; ``refresh`` asks again."""
        return self.job.state

    @property
    def ended(self) -> bool:
        """Whether it had come to its end by then."""
        return job_calls.ended(self.job.state)

    def patient(self, patience_s: float) -> "JobHandle":
        """The same job, with more patience or less while nobody answers."""
        return JobHandle(self._line.patient(patience_s), self.job)

    def refresh(self, wait_s: float = 0.0) -> Job:
        """Ask how it is; with a time to wait, the answer comes then, or as soon as it has ended."""
        return self._seen(self._line.send(job_calls.job(self.id, wait_s)))

    def wait(self, timeout_s: float | None = None) -> Job:
        """Wait for its end; raises WaitTimeoutError where it takes longer."""
        until_s = None if timeout_s is None else self._line.clock() + timeout_s
        while not self.ended:
            left_s = None if until_s is None else until_s - self._line.clock()
            if left_s is not None and left_s <= 0.0:
                raise WaitTimeoutError(
                    f"job {self.id} is {self.state} after {timeout_s:g} s, and goes on"
                )
            self.refresh(job_calls.wait_s(left_s))
        return self.job

    def start(self) -> Job:
        """Let a job begin that is ready."""
        return self._act("start")

    def pause(self) -> Job:
        """Come to rest at the next safe point; a held part is held on with its force."""
        return self._act("pause")

    def resume(self) -> Job:
        """Go on after a pause."""
        return self._act("resume")

    def stop(self) -> Job:
        """Stop; a held part stays held until ``release``."""
        return self._act("stop")

    def abort(self) -> Job:
        """Trip the actuator, which goes to its safe state and latches."""
        return self._act("abort")

    def release(self) -> Job:
        """Let the part go."""
        return self._act("release")

    def proceed(self) -> Job:
        """Go on where the job waits for a person: the action ``continue``."""
        return self._act("continue")

    def events(self, after: int = 0) -> Iterator[Event]:
        """Events of the job until it is over, those that have been included, each once."""

        def over() -> bool:
            self.refresh()
            return self.ended

        return self._line.events(f"/jobs/{self.id}/events", after, over)

    def result(self) -> AnyResult | None:
        """What came of it; None where it has not moved."""
        return result_of(self.job)

    def artifacts(self) -> list[Artifact]:
        """Files of its record."""
        found = self._line.send(job_calls.artifacts(self.id))
        return found.artifacts

    def download(self, name: str, folder: str | Path = ".") -> Path:
        """Bring one file of its record here, whole or not at all."""
        listed = {file.name: file.sha256 for file in self.artifacts()}
        landing = Landing(name, Path(folder), listed.get(name))
        return self._line.land(job_calls.artifact(self.id, name), landing)

    def _act(self, action: ActionType) -> Job:
        return self._seen(self._line.send(job_calls.act(self.id, action)))

    def _seen(self, job: Job) -> Job:
        self.job = job
        return job
