"""Kinds of job over REST: data to build forms, command lines and views."""

from typing import Any, cast

from pydantic import BaseModel

from pincette.api import Model, example
from pincette.api.job_kinds import Choice, FieldSpec, JobKind, ResultField, Widget, choices
from pincette.api.requests import OnStop
from pincette.api.states import ActionType
from pincette.core.units import unit_of

FROM_RIG_FILE = "as in the rig file"
Schema = dict[str, Any]


class FormField(FieldSpec):
    """A field of a form with all its properties."""

    model_config = example(
        name="force_mN",
        label="Force",
        widget="number",
        choices=None,
        placeholder="as in the rig file",
        limit="force_max",
        when={},
        excludes="",
        advanced=False,
        planned="load.force_mN",
        required=False,
        names=False,
        named_by="",
        sent_as="",
        within="",
        own_unit="",
        meaning="",
        arms=(1, 2),
        unit="mN",
        minimum=0.0,
        maximum=None,
        whole=False,
        ticked=False,
        columns=[],
    )

    unit: str
    minimum: float | None
    maximum: float | None
    whole: bool
    """True if the value must be an integer."""
    ticked: bool
    """True if the checkbox is ticked by default."""
    columns: tuple[str, ...]
    """Names of the two numbers of each pair."""


class KindVariant(Model):
    """One of several requests of a kind."""

    model_config = example(name="noise", label="noise of the sensor", summary="…", request={})

    name: str
    label: str
    summary: str
    request: dict[str, Any]
    """JSON schema of the request; each member with a unit has the property ``unit``."""


class Kind(Model):
    """A kind of job."""

    model_config = example(
        name="grip",
        label="Grip",
        summary="Grip the part of the rig file, hold it and release it.",
        request={"properties": {"force_mN": {"type": "number", "unit": "mN"}}},
        variant_field="",
        variants=[],
        form=[],
        figures=[],
        actions=["start", "pause", "resume", "stop", "abort", "release"],
        plot="grip.png",
        begins_held=False,
        holds_part=True,
        predicted=True,
        takes_recipe=True,
        jogs=False,
        proposes=False,
        arms=[1, 2],
        on_stop="hold",
    )

    name: str
    """Name of the kind in the member ``kind`` of requests."""
    label: str
    summary: str
    request: dict[str, Any]
    """JSON schema of the request; each member with a unit has the property ``unit``. If the kind
    has variants, the schema contains their common members.
    """
    variant_field: str
    """Member of the request that chooses a variant; empty if there are none."""
    variants: list[KindVariant]
    form: list[FormField]
    """Fields of the form, in the order of display."""
    figures: list[ResultField]
    """Result values to be shown, in the order of display."""
    actions: list[ActionType]
    """Actions that clients can request for jobs of this kind. A job's ``allowed_actions`` lists
    those that it accepts now.
    """
    plot: str
    """File name of the job's plot in the record."""
    begins_held: bool
    """True if the job begins with a part that is already held."""
    holds_part: bool
    """True if a stop or an abort can keep or release a part."""
    predicted: bool
    """True if the motion is predicted before the start and can be stored as a trajectory."""
    takes_recipe: bool
    jogs: bool
    """True if a page should show buttons for arm steps and taught poses beside the form."""
    proposes: bool
    """True if the result proposes values for the model in use."""
    arms: list[int]
    """Numbers of driven arms for which the kind is available."""
    on_stop: OnStop
    """Action on a held part when a job is stopped, for kinds whose request has no ``on_stop``."""


class KindList(Model):
    """Every kind of job that is installed."""

    model_config = example(kinds=[])

    kinds: list[Kind]


def described(kind: JobKind) -> Kind:
    """Return a kind in the form that the supervisor sends."""
    variants = [
        KindVariant(
            name=one.name, label=one.label, summary=one.summary, request=schema_of(one.request)
        )
        for one in kind.variants.values()
    ]
    return Kind(
        name=kind.name,
        label=kind.label,
        summary=kind.summary,
        request=schema_of(kind.request),
        variant_field=kind.variant_field,
        variants=variants,
        form=_form(kind),
        figures=list(kind.figures),
        actions=list(kind.actions),
        plot=kind.plot,
        begins_held=kind.begins_held,
        holds_part=kind.holds_part,
        predicted=kind.predicted,
        takes_recipe=kind.recipe is not None,
        jogs=kind.jogs,
        proposes=kind.proposes,
        arms=list(kind.arms),
        on_stop=kind.on_stop,
    )


def schema_of(request: type[BaseModel]) -> dict[str, Any]:
    """Return the JSON schema of a request, with units."""
    schema = request.model_json_schema()
    parts = [schema, *schema.get("$defs", {}).values()]
    for name, member in ((n, m) for part in parts for n, m in part.get("properties", {}).items()):
        if unit := unit_of(name):
            member["unit"] = unit
    return schema


def _form(kind: JobKind) -> list[FormField]:
    schema = schema_of(kind.request)
    form = [complete(spec, schema) for spec in kind.form]
    if not kind.variants:
        return form
    labels = choices(*((one.name, one.label) for one in kind.variants.values()))
    chosen = FieldSpec(
        name=kind.variant_field,
        label=kind.variant_field.capitalize(),
        widget="choice",
        choices=labels,
    )
    found: dict[str, FormField] = {}
    for one in kind.variants.values():
        schema = schema_of(one.request)
        for spec in one.form:
            field = complete(spec, schema).model_copy(
                update={"when": {**spec.when, kind.variant_field: (one.name,)}}
            )
            known = found.get(spec.name)
            found[spec.name] = field if known is None else _both(known, field, kind.variant_field)
    return [complete(chosen, {}), *form, *found.values()]


def _both(first: FormField, second: FormField, variant_field: str) -> FormField:
    """Return one field that accepts the values of both variants."""
    bounds = {
        name: None
        if None in (found := [getattr(one, name) for one in (first, second)])
        else widest(found)
        for name, widest in (("minimum", min), ("maximum", max))
    }
    when = {variant_field: (*first.when[variant_field], *second.when[variant_field])}
    return first.model_copy(
        update={**bounds, "when": {**first.when, **when}, "placeholder": "default"}
    )


def complete(spec: FieldSpec, schema: Schema) -> FormField:
    """Return a field completed from the JSON schema of its request."""
    member, default, nullable = _member(spec.name, schema)
    widget = spec.widget or _widget(member)
    found = spec.choices
    if widget == "choice" and found is None:
        found = _choices(member, default, nullable=nullable)
    placeholder = spec.placeholder
    if placeholder is None:
        shown = f"{default:g}" if _is_number(default) else FROM_RIG_FILE
        placeholder = ", ".join(f"{one:g}" for one in default) if _are_numbers(default) else shown
    items = _resolved(cast("Schema", member.get("items", {})), schema)
    return FormField(
        **spec.model_dump(exclude={"widget", "choices", "placeholder"}),
        widget=widget,
        choices=found,
        placeholder=placeholder,
        unit="" if widget == "pairs" else spec.own_unit or unit_of(spec.name),
        minimum=_bound(member, "minimum", "exclusiveMinimum"),
        maximum=_bound(member, "maximum", "exclusiveMaximum"),
        whole=member.get("type") == "integer",
        ticked=widget == "check" and default is True,
        columns=tuple(items.get("properties", ())) if widget == "pairs" else (),
    )


def _member(name: str, schema: Schema) -> tuple[Schema, Any, bool]:
    """Return the schema of a member, its default, and whether it may be null."""
    member = cast("Schema", schema.get("properties", {}).get(name, {}))
    default = member.get("default")
    options = [_resolved(one, schema) for one in member.get("anyOf", [member])]
    wanted = [one for one in options if one.get("type") != "null"]
    return (wanted[0] if wanted else {}), default, len(wanted) < len(options)


def _resolved(schema: Schema, root: Schema) -> Schema:
    reference = schema.get("$ref")
    if reference is None:
        return schema
    return cast("Schema", root["$defs"][reference.rpartition("/")[2]])


def _widget(member: Schema) -> Widget:
    if "enum" in member or "const" in member:
        return "choice"
    if member.get("type") == "array":
        items = member.get("items", {})
        return "pairs" if "$ref" in items else "words" if items.get("type") == "string" else "list"
    widgets: dict[Any, Widget] = {"boolean": "check", "string": "text"}
    return widgets.get(member.get("type"), "number")


def _choices(member: Schema, default: Any, *, nullable: bool) -> tuple[Choice, ...]:
    values = [str(one) for one in member.get("enum", ())]
    first = choices(("", FROM_RIG_FILE)) if nullable and default is None else ()
    return (*first, *(Choice(value=one, label=one.replace("_", " ")) for one in values))


def _bound(member: Schema, *names: str) -> float | None:
    found = next((member[name] for name in names if name in member), None)
    return None if found is None else float(found)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _are_numbers(value: Any) -> bool:
    return isinstance(value, list) and all(_is_number(one) for one in cast("list[Any]", value))
