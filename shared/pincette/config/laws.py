"""Installed control laws, and the default law of a rig's jobs."""

from functools import cache
from typing import TYPE_CHECKING

from pydantic import ConfigDict, Field, ValidationError, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError

from pincette.config.tables import Table
from pincette.control.laws.definition import LawDefinition, LawSettings
from pincette.control.laws.parameters import ForceAge, LawSpec, ParameterSet
from pincette.control.laws.two_arm_law import LAW as TWO_ARMS
from pincette.control.laws.two_arm_law import TwoArmLaw
from pincette.core import plugins

if TYPE_CHECKING:
    from pincette.api.plans import InstalledLaw


@cache
def law_definition(scheme: str) -> LawDefinition:
    """Return an installed law by its name; raises ValueError."""
    try:
        found = plugins.load(plugins.LAWS, scheme)
    except plugins.PluginError as error:
        raise ValueError(str(error)) from error
    if found is TWO_ARMS:
        raise ValueError(
            f"law {scheme!r} drives two arms: a rig with [second] uses it by default; leave "
            "scheme out"
        )
    if not isinstance(found, LawDefinition) or found.name != scheme:
        wanted = f"a LawDefinition named {scheme!r}"
        raise ValueError(f"control law {scheme!r} cannot be used: its entry point is not {wanted}")
    return found


def installed_laws() -> dict[str, LawDefinition]:
    """Return the usable laws for one arm, by name; laws with faults are omitted."""
    found: dict[str, LawDefinition] = {}
    for scheme in plugins.names(plugins.LAWS):
        try:
            found[scheme] = law_definition(scheme)
        except ValueError:
            continue
    return found


def laws_by_name() -> dict[str, LawDefinition | TwoArmLaw]:
    """Return the usable laws for one arm and for two, by name."""
    found: dict[str, LawDefinition | TwoArmLaw] = {**installed_laws(), TWO_ARMS.name: TWO_ARMS}
    return {name: found[name] for name in plugins.names(plugins.LAWS) if name in found}


def described_laws() -> "list[InstalledLaw]":
    """Return a description of every installed law, as listed over REST."""
    from pincette.api.plans import InstalledLaw, LawGain

    return [
        InstalledLaw(
            scheme=law.name,
            title=law.title,
            summary=law.summary,
            gains=[LawGain.model_validate(gain, from_attributes=True) for gain in law.parameters],
            tunable=bool(law.search),
            arms=law.arms,
        )
        for law in laws_by_name().values()
    ]


def resolved_law(spec: LawSpec) -> LawSettings:
    """Return the law of a program with all its gains; raises ValueError."""
    return law_definition(spec.scheme).resolve(spec)


def default_set(*, identified: bool) -> ParameterSet:
    """Return the default parameter set of a law, with or without an identified response."""
    return "identified" if identified else "consistent"


class Law(Table):
    """Scheme, parameter set and gains of a law."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, float] = Field(init=False)  # pyright: ignore[reportIncompatibleVariableOverride]

    scheme: str = "pbsmic"
    """Name of the law; `pincette doctor --drivers` lists the installed laws."""
    set: ParameterSet | None = None
    """Parameter set of the law. "consistent": m, b, k, d of the rig. "printed": those of the paper.
    "identified": those of the rig, with the free response in place of the line d·u. Default:
    "identified" if the model in use has an identified free response, else "consistent".
    """
    force_age: ForceAge = "planned"
    """Force F_k used by the law: the newest estimate unchanged, or extrapolated to sample k by the
    change of F_r.
    """

    @model_validator(mode="after")
    def _of_an_installed_law(self) -> "Law":
        try:
            definition = law_definition(self.scheme)
        except ValueError as error:
            raise _refused({"scheme": (self.scheme, str(error))}) from error
        if faults := _faults(definition, self.gains):
            raise _refused(faults)
        return self

    @property
    def gains(self) -> dict[str, float]:
        """Return the gains stated in the file; the law's defaults complete them."""
        return dict(self.__pydantic_extra__)

    def settings(self, used: ParameterSet) -> LawSettings:
        """Return the law of a set with all its gains.

        ``RigFile.law_set`` determines which set is used.
        """
        definition = law_definition(self.scheme)
        # Gains that the file omits have the program's defaults, also in the printed set.
        of_set: ParameterSet = "consistent" if used == "printed" else used
        gains = {each.name: each.value(of_set) for each in definition.parameters} | self.gains
        return definition.settings(used, force_age=self.force_age, **gains)


def _faults(definition: LawDefinition, gains: dict[str, float]) -> dict[str, tuple[object, str]]:
    """Return the gains that the law does not have or does not accept, each with its value and the
    reason.
    """
    parameters = {parameter.name: parameter for parameter in definition.parameters}
    faults: dict[str, tuple[object, str]] = {}
    for name, value in gains.items():
        if name not in parameters:
            there = ", ".join(parameters)
            faults[name] = value, f"{definition.title} has no such gain; there are {there}"
            continue
        try:
            parameters[name].check(value)
        except ValueError as error:
            faults[name] = value, str(error)
    return faults


def _refused(faults: dict[str, tuple[object, str]]) -> ValidationError:
    details = [
        InitErrorDetails(
            type=PydanticCustomError("law", "{text}", {"text": text}), loc=(name,), input=value
        )
        for name, (value, text) in faults.items()
    ]
    return ValidationError.from_exception_data("law", details)
