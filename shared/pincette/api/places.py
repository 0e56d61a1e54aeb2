"""Places of parts as stated by a request or a vision client, and their differences from where the
parts were found.
"""

from datetime import UTC, datetime
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from pincette.api import Model, example
from pincette.control.vocabulary import LARGEST

MEASURED: dict[str, Any] = {
    "x_um": 31.0,
    "u_um": 0.5,
    "measured_at": "2026-03-01T12:00:00.250Z",
    "source": "camera-1",
}
Micrometres = Annotated[float, Field(ge=-LARGEST["µm"], le=LARGEST["µm"])]
Width = Annotated[float, Field(gt=0, le=LARGEST["µm"])]


def in_utc(text: str) -> str:
    """Return a time in UTC, to the millisecond; raises ValueError if it has no time zone."""
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        found = None
    if found is None or found.tzinfo is None:
        raise ValueError(
            f"{text!r:.60} is no time with its zone: give ISO 8601, such as "
            "2026-03-01T12:00:00.250Z"
        )
    return found.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


Moment = Annotated[str, AfterValidator(in_utc)]
Source = Annotated[str, Field(min_length=1, max_length=80)]


class MeasuredPlace(Model):
    """Place of a part, measured by a camera or another instrument beside the gripper."""

    model_config = example(**MEASURED)

    x_um: Micrometres
    """Arm position at first contact; with two arms, the place q = (x_1 - x_2)/2."""
    u_um: Width
    """Expanded uncertainty (k = 2) of ``x_um``."""
    width_um: Width | None = None
    """Width of the part, for two arms only. It needs ``u_width_um``."""
    u_width_um: Width | None = None
    """Expanded uncertainty (k = 2) of ``width_um``. It needs ``width_um``."""
    measured_at: Moment
    """Time of the measurement in ISO 8601, with its time zone."""
    source: Source
    """Name of the instrument. Differences between stated and found places are averaged for each
    name.
    """

    @model_validator(mode="after")
    def _both_of_the_width(self) -> Self:
        if (self.width_um is None) != (self.u_width_um is None):
            raise ValueError("width_um and u_width_um belong together: give both or none")
        return self

    def seconds_until(self, now: datetime) -> float:
        """Return the time since the measurement, in s; negative if the measurement lies in the
        future.
        """
        return (now - datetime.fromisoformat(self.measured_at)).total_seconds()


class PartPlace(Model):
    """Member ``place`` of a request: the expected place of the part; it replaces the place in the
    rig file.

    It needs ``x_um``, ``u_um``, ``measured_at`` and ``source``, unless ``given_by`` is ``bus``.
    """

    model_config = example(**MEASURED, max_age_s=5.0)

    x_um: Micrometres | None = None
    """Arm position at first contact; with two arms, the place q = (x_1 - x_2)/2. Required unless
    ``given_by`` is ``bus``.
    """
    u_um: Width | None = None
    """Expanded uncertainty (k = 2) of ``x_um``; the arm searches for the part within it. Required
    unless ``given_by`` is ``bus``.
    """
    width_um: Width | None = None
    """Width of the part, for two arms only. It needs ``u_width_um``, and ``second.gap_um`` in the
    rig file.
    """
    u_width_um: Width | None = None
    """Expanded uncertainty (k = 2) of ``width_um``. It needs ``width_um``."""
    measured_at: Moment | None = None
    """Time of the measurement in ISO 8601, with its time zone. Required unless ``given_by`` is
    ``bus``.
    """
    source: Annotated[str, Field(max_length=80)] = ""
    """Name of the instrument. Required unless ``given_by`` is ``bus``; with ``bus`` it may be empty
    when there is only one source.
    """
    max_age_s: Annotated[float, Field(gt=0, le=3600)] = 5.0
    """Largest permitted age of the measurement, both when the job is planned and when it starts to
    move.
    """
    given_by: Literal["request", "bus"] = "request"
    """``bus``: use the newest place that a vision client has published for the rig. ``x_um``,
    ``u_um``, ``width_um``, ``u_width_um`` and ``measured_at`` must then be omitted.
    """

    @model_validator(mode="after")
    def _one_origin(self) -> Self:
        stated = {name: getattr(self, name) for name in MeasuredPlace.model_fields}
        if self.given_by == "request":
            missing = [name for name in MEASURED if not stated[name] and stated[name] != 0.0]
            if missing:
                raise ValueError(
                    f"a place needs {', '.join(missing)}; or ask for given_by = bus, the newest "
                    "place that a vision client has published"
                )
            self.measured()
        elif given := [name for name, value in stated.items() if value and name != "source"]:
            raise ValueError(f"given_by = bus takes {', '.join(given)} from the bus: leave it out")
        return self

    def measured(self) -> MeasuredPlace:
        """Return the place that the request states; None if it does not state one."""
        return MeasuredPlace(**{name: getattr(self, name) for name in MeasuredPlace.model_fields})


class PlannedPlace(MeasuredPlace):
    """Place for which a job was planned, and the range in which the arm searches for the part."""

    model_config = example(
        **MEASURED, age_s=0.4, max_age_s=5.0, search_from_um=[29.5], search_to_um=[33.9]
    )

    age_s: float
    """Age of the measurement when the job was planned."""
    max_age_s: float
    search_from_um: list[float] = Field(default_factory=list)
    """Position of each arm at which the approach ends and the slower search begins."""
    search_to_um: list[float] = Field(default_factory=list)
    """Position of each arm at which the search ends if no part was found."""


class PlaceBias(Model):
    """Statistics of the differences between the places stated by one source and those where the arm
    found the part.
    """

    model_config = example(source="camera-1", count=12, mean_um=0.31, deviation_um=0.12)

    source: str
    count: int
    """Number of jobs included, at most the newest 100."""
    mean_um: float
    """Mean of found minus stated place. Adding it to the camera's offset removes the bias."""
    deviation_um: float | None = None
    """Standard deviation of the differences; null for one job."""
    width_count: int = 0
    width_mean_um: float | None = None
    """Mean of found minus stated width; null if no width was stated."""
    width_deviation_um: float | None = None


class PlaceFound(Model):
    """Place where the arm found the part, compared with the stated place."""

    model_config = example(
        source="camera-1",
        age_s=0.4,
        given_um=31.0,
        found_um=31.18,
        difference_um=0.18,
        uncertainty_um=0.52,
    )

    source: str
    age_s: float
    """Age of the measurement when the job was planned."""
    given_um: float
    found_um: float | None
    """Place where the arm found the part; null if it found none."""
    difference_um: float | None
    """Found minus stated place."""
    uncertainty_um: float | None
    """Expanded uncertainty (k = 2) of the difference."""
    width_given_um: float | None = None
    width_found_um: float | None = None
    width_difference_um: float | None = None
    """Found minus stated width."""
    width_uncertainty_um: float | None = None
    """Expanded uncertainty (k = 2) of ``width_difference_um``."""
    bias: PlaceBias | None = None
    """Differences of this source over all jobs of the rig up to now, including this one."""


class SeenPlace(MeasuredPlace):
    """Newest place that one source has published on the bus."""

    model_config = example(**MEASURED, age_s=0.4)

    age_s: float


class PlaceList(Model):
    """Places that vision clients have published for a rig, and their differences from where the
    parts were found.
    """

    model_config = example(
        rig="demo",
        key="pincette/v2/demo/place",
        newest=[{**MEASURED, "age_s": 0.4}],
        biases=[{"source": "camera-1", "count": 12, "mean_um": 0.31, "deviation_um": 0.12}],
        refused="",
    )

    rig: str
    key: str
    """Key on the bus on which a vision client publishes places."""
    newest: list[SeenPlace]
    """Newest place of each source."""
    biases: list[PlaceBias]
    refused: str
    """Reason why the last message on the key was rejected; empty if it was accepted."""
