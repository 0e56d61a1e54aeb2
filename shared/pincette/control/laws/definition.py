"""Definition of a control law: data and pure functions, registered under ``pincette.laws``.

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

from pincette.control.arm.plant import DifferenceEquation
from pincette.control.laws.history import History
from pincette.control.laws.impedance import ImpedanceParameters
from pincette.control.laws.parameters import ForceAge, Gain, LawParameter, LawSpec, ParameterSet
from pincette.control.laws.sliding import LawOutput

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
else:
    Array = Any  # Commands and control programs start without importing NumPy.


class BuildLaw(Protocol):
    """Function that builds the parameters of ``step``; raises ValueError."""

    def __call__(
        self, plant: DifferenceEquation, gains: Mapping[str, float], period_s: float, /
    ) -> Any:
        """Return the parameters for a model of the arm, gains by name, and the period in s."""
        ...


class StartLaw(Protocol):
    """Function that returns the state for a bumpless start; the first step gets the same ``x_um``.

    The returned state is a frozen dataclass of floats and of such dataclasses; the field
    ``history`` contains the given ``History``.
    """

    def __call__(
        self,
        parameters: Any,
        history: History,
        /,
        *,
        x_um: float,
        x_r_um: float,
        force_error_mN: float,
    ) -> Any:
        """Return the state for x_{k-1} and x_{r,k-1} in µm, and F - F_r in mN."""
        ...


class StepLaw(Protocol):
    """Function that computes u_k; for the ages of its arguments see ``pbsmic.step``.

    A law with ``previews`` receives the additional argument ``plan``, a ``PlannedMotion``.
    """

    def __call__(
        self,
        parameters: Any,
        state: Any,
        /,
        *,
        x_um: float,
        force_mN: float,
        applied_V: float,
        x_r_um: float,
        force_r_mN: float,
        limited: int,
    ) -> tuple[Any, LawOutput]:
        """Return the next state and the output."""
        ...


@dataclass(frozen=True, slots=True)
class LawDefinition:
    """A law: its name, its gains, and its functions."""

    name: str
    """Name of the law, equal to that of its registration."""
    title: str
    summary: str
    """One line that distinguishes the law from the others."""
    parameters: tuple[LawParameter, ...]
    build: BuildLaw
    start: StartLaw
    step: StepLaw | Callable[..., tuple[Any, LawOutput]]
    impedance: Callable[[Mapping[str, float]], ImpedanceParameters]
    """Function that returns the impedance (10) of the law. K and K_f of the impedance give the
    steady errors."""
    linearise: Callable[[Any], Array] | None = None
    """Function that returns the matrix of one step of the built ``Law``; None: the matrix is
    computed from the step. See ``loop_matrix.law_matrix``."""
    search: tuple[tuple[str, tuple[float, ...]], ...] = ()
    """Gains, with their values, that are varied in the search for balanced gains; empty: no
    search."""
    switching: str = ""
    """Name of the gain of the switching term; the value 0 of this gain switches the term off. ""
    for a law without a switching term."""
    remedies: Callable[[Mapping[str, float]], Sequence[tuple[str, Sequence[float]]]] | None = None
    """Function that returns gains which a refusal may propose to change, each with the values to
    try, the smallest change first."""
    previews: bool = False
    """True if ``step`` receives the planned motion and the contact. Such a law receives the force
    error as estimated, without the rig's low-pass, and keeps its state at the start of a segment,
    since the plan contains the contact."""
    rebase: Callable[[Any], Any] | None = None
    """Function that returns the state of a law with ``previews`` after the contact begins or ends
    in the plan; None: the state is kept."""
    arms: int = 1
    """Number of arms that the law drives."""

    def settings(
        self,
        parameter_set: ParameterSet = "consistent",
        *,
        force_age: ForceAge | None = None,
        **gains: float,
    ) -> "LawSettings":
        """Return complete gains, with the defaults of a parameter set.

        ``force_age`` None means ``newest`` for the printed set, as in the paper, and ``planned``
        for the others. To build a law with the identified set, the free response is needed; see
        ``law.build``.

        Raises
        ------
        ValueError
            If the law has no such gain, or does not accept its value.
        """
        values = {each.name: each.value(parameter_set) for each in self.parameters}
        found = LawSettings(
            self,
            parameter_set,
            force_age or ("newest" if parameter_set == "printed" else "planned"),
            tuple(values.values()),
        )
        return found.with_gains(**gains)

    def resolve(self, spec: LawSpec) -> "LawSettings":
        """Return the complete law for the law named in a motion program.

        Raises ValueError as ``settings`` does.
        """
        gains = {gain.name: gain.value for gain in spec.gains}
        return self.settings(spec.set, force_age=spec.force_age, **gains)


@dataclass(frozen=True, slots=True)
class LawSettings:
    """A law with its gains, in µm, mN and s; made by ``LawDefinition.settings``.

    Raises
    ------
    ValueError
        If the law does not accept a gain.
    """

    definition: LawDefinition
    set: ParameterSet
    force_age: ForceAge
    values: tuple[float, ...]
    """Gains in the order of ``definition.parameters``."""

    def __post_init__(self) -> None:
        for parameter, value in zip(self.definition.parameters, self.values, strict=True):
            parameter.check(value)

    @property
    def scheme(self) -> str:
        """Return the name of the law."""
        return self.definition.name

    @property
    def gains(self) -> dict[str, float]:
        """Return the gains by name."""
        names = (parameter.name for parameter in self.definition.parameters)
        return dict(zip(names, self.values, strict=True))

    @property
    def switches(self) -> bool:
        """Return True if the switching term is on."""
        name = self.definition.switching
        return bool(name) and self.gains[name] > 0.0

    def with_gains(self, **gains: float) -> "LawSettings":
        """Return the same law with other gains; raises ValueError."""
        values = self.gains
        for name in gains:
            if name not in values:
                raise ValueError(
                    f"{self.definition.title} has no gain {name}; its gains are {', '.join(values)}"
                )
        return replace(self, values=tuple((values | gains).values()))

    def spec(self) -> LawSpec:
        """Return the settings in the form used in a motion program."""
        gains = tuple(Gain(name, value) for name, value in self.gains.items())
        return LawSpec(self.scheme, self.set, self.force_age, gains)
