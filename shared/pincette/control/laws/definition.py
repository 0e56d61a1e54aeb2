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
    Array = Any  # a command and a program of the loop start without NumPy


class BuildLaw(Protocol):
    """Make what ``step`` needs of the model, the gains and the period; raises ValueError."""

    def __call__(
        self, plant: DifferenceEquation, gains: Mapping[str, float], period_s: float, /
    ) -> Any:
        """Take the model of the arm, gains by name, and the period in s."""
        ...


class StartLaw(Protocol):
    """Begin a segment without a bump, just before the step that gets the same ``x_um``.

    The state that is returned is a frozen dataclass of floats and of such dataclasses; its field
    ``history`` is the ``History`` that was given.
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
        """Take x_{k-1}, x_{r,k-1} in µm, F - F_r in mN."""
        ...


class StepLaw(Protocol):
    """Compute u_k; which sample is which: ``pbsmic.step``.

    A law that ``previews`` gets a further argument ``plan``, a ``PlannedMotion``.
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
    """A law: what it is called, its gains, and the functions that it runs by."""

    name: str
    """The scheme; the same as in its line of registration."""
    title: str
    summary: str
    """One line that distinguishes it from the others."""
    parameters: tuple[LawParameter, ...]
    build: BuildLaw
    start: StartLaw
    step: StepLaw | Callable[..., tuple[Any, LawOutput]]
    impedance: Callable[[Mapping[str, float]], ImpedanceParameters]
    """The impedance (10) that the law renders, of which K and K_f give the steady errors."""
    linearise: Callable[[Any], Array] | None = None
    """Takes the built ``Law``, returns the matrix of its step; None: it is read off the step. See
    ``loop_matrix.law_matrix``."""
    search: tuple[tuple[str, tuple[float, ...]], ...] = ()
    """Gains that a search for balanced gains varies, each with its values; (): no search."""
    switching: str = ""
    """The gain of a switching term, which 0 switches off; "": there is none."""
    remedies: Callable[[Mapping[str, float]], Sequence[tuple[str, Sequence[float]]]] | None = None
    """Other gains that a refusal may propose, each with its values, the gentlest first."""
    previews: bool = False
    """Whether ``step`` is told of the planned motion and of the contact, gets the force error as
    it was estimated, without the rig's low-pass, and goes on through the begin of a segment with
    the state it has: a touch is then a matter of the plan it is told of."""
    rebase: Callable[[Any], Any] | None = None
    """Of a law that previews: what becomes of its state where the force input begins or ends, that
    is where a contact is told of, or told of no more; None: nothing."""
    arms: int = 1
    """Number of arms that it drives."""

    def settings(
        self,
        parameter_set: ParameterSet = "consistent",
        *,
        force_age: ForceAge | None = None,
        **gains: float,
    ) -> "LawSettings":
        """Return complete gains, by the defaults of a parameter set.

        ``force_age`` None is ``newest`` for the printed set, as in the paper, else ``planned``.
        A law of the identified set is built with the free response; see ``law.build``.

        Raises
        ------
        ValueError
            Where the law has no such gain, or cannot take its value.
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
        """Return the complete law that a program names; raises ValueError as ``settings``."""
        gains = {gain.name: gain.value for gain in spec.gains}
        return self.settings(spec.set, force_age=spec.force_age, **gains)


@dataclass(frozen=True, slots=True)
class LawSettings:
    """A law with its gains, in µm, mN and s; made by ``LawDefinition.settings``.

    Raises
    ------
    ValueError
        Where the law cannot take a gain.
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
        """Whether a switching term acts."""
        name = self.definition.switching
        return bool(name) and self.gains[name] > 0.0

    def with_gains(self, **gains: float) -> "LawSettings":
        """Return the same law with other gains; raises ValueError."""
        values = self.gains
        for name in gains:
            if name not in values:
                raise ValueError(
                    f"{self.definition.title} has no gain {name}; there are {', '.join(values)}"
                )
        return replace(self, values=tuple((values | gains).values()))

    def spec(self) -> LawSpec:
        """Return the settings as a program carries them."""
        gains = tuple(Gain(name, value) for name, value in self.gains.items())
        return LawSpec(self.scheme, self.set, self.force_age, gains)
