"""The REST application of the rigs of one supervisor, and its OpenAPI document.

``python -m pincette_supervisor.rest.api FILE`` writes that document.
"""

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

from fastapi import FastAPI

from pincette import __version__
from pincette.api import BASE
from pincette.api.job_kinds import job_kinds
from pincette.api.problems import Problem, responses
from pincette.api.results import JobResult
from pincette_supervisor import problems
from pincette_supervisor.access.access import Access
from pincette_supervisor.fleet.rigs import Rigs
from pincette_supervisor.rest import (
    routes_access,
    routes_events,
    routes_job_list,
    routes_jobs,
    routes_model,
    routes_page,
    routes_probes,
    routes_rigs,
    routes_series,
    routes_trajectories,
)
from pincette_supervisor.rest.dependencies import cookie_name
from pincette_supervisor.rest.limits import ESTOP, MOST_BYTES, SMALL_BYTES, NormalTarget, RateLimit
from pincette_supervisor.rest.middleware import AuditLog, HeadAndOptions, OriginCheck

SCHEMAS = "#/components/schemas/"
NAMES = {
    401: "NoKey",
    403: "NotAllowed",
    408: "BodyTooSlow",
    413: "BodyTooLarge",
    415: "UnsupportedMediaType",
    421: "ForeignHost",
    422: "InvalidRequest",
    429: "TooManyRequests",
    503: "Busy",
}
EVERYWHERE, WITH_KEY, WITH_BODY = (403, 421, 422, 429, 503), (401,), (408, 413, 415)

OPERATIONS = {
    "post /estop": "estop_all_rigs",
    "get /rigs": "list_rigs",
    "get /rigs/{rig}": "get_rig",
    "post /rigs/{rig}/estop": "estop_rig",
    "post /rigs/{rig}/reset": "reset_rig",
    "put /rigs/{rig}/claim": "claim_rig",
    "delete /rigs/{rig}/claim": "give_back_rig",
    "post /rigs/{rig}/queue/actions": "control_queue",
    "get /rigs/{rig}/places": "list_places",
    "get /rigs/{rig}/timing": "get_timing",
    "get /rigs/{rig}/model": "get_model",
    "get /rigs/{rig}/checklist": "get_checklist",
    "post /rigs/{rig}/model/actions": "use_model",
    "get /rigs/{rig}/history": "get_history",
    "get /rigs/{rig}/samples": "list_samples",
    "get /rigs/{rig}/live": "stream_samples",
    "get /jobs": "list_jobs",
    "post /jobs": "start_job",
    "get /jobs/export.csv": "export_jobs_as_csv",
    "get /jobs/export.numbers.csv": "export_numbers_as_csv",
    "get /jobs/export.numbers.csv-metadata.json": "describe_numbers",
    "get /jobs/export.parquet": "export_jobs_as_parquet",
    "patch /jobs/{job}": "describe_job",
    "get /jobs/{job}": "get_job",
    "delete /jobs/{job}/record": "delete_record",
    "post /jobs/stop": "stop_request",
    "post /jobs/{job}/actions": "act_on_job",
    "get /jobs/{job}/artifacts": "list_artifacts",
    "get /jobs/{job}/artifacts/{name}": "get_artifact",
    "get /jobs/{job}/artifacts/{name}/content": "get_artifact_content",
    "post /series": "start_series",
    "get /series": "list_series",
    "get /series/{series}": "get_series",
    "post /series/{series}/actions": "act_on_series",
    "get /series/{series}/report": "get_series_report",
    "get /series/{series}/plot": "plot_series",
    "get /kinds": "list_job_kinds",
    "get /laws": "list_laws",
    "post /calibrations": "start_calibration",
    "get /calibrations": "list_proposals",
    "get /calibrations/{calibration}": "get_proposal",
    "post /calibrations/{calibration}/actions": "decide_proposal",
    "get /rigs/{rig}/learning": "list_learned_programs",
    "delete /rigs/{rig}/learning": "erase_learned_programs",
    "delete /rigs/{rig}/learning/{program}": "erase_learned_program",
    "post /recipes": "save_recipe",
    "get /recipes": "list_recipes",
    "get /recipes/{name}": "get_recipe",
    "get /recipes/{name}/{version}": "get_recipe_version",
    "get /rigs/{rig}/simulation/commands": "list_simulation_commands",
    "post /rigs/{rig}/simulation/commands": "simulate",
    "post /trajectories": "save_trajectory",
    "get /trajectories": "list_trajectories",
    "post /trajectories/plot": "plot_plan",
    "get /trajectories/{digest}": "get_trajectory",
    "get /trajectories/{digest}/samples": "get_trajectory_samples",
    "get /trajectories/{digest}/samples.csv": "get_trajectory_as_csv",
    "get /trajectories/{digest}/samples.parquet": "get_trajectory_as_parquet",
    "get /trajectories/{digest}/plot": "plot_trajectory",
    "post /trajectories/{digest}/jobs": "start_trajectory",
    "get /jobs/{job}/events/list": "list_job_events",
    "get /rigs/{rig}/events/list": "list_rig_events",
    "get /events/list": "list_events",
    "get /jobs/{job}/events": "stream_job_events",
    "get /rigs/{rig}/events": "stream_rig_events",
    "get /events": "stream_events",
    "get /alarms": "list_alarms",
    "get /alarms/{alarm}": "get_alarm",
    "post /alarms/{alarm}/actions": "acknowledge_alarm",
    "get /session": "get_session",
    "post /session": "sign_in",
    "delete /session": "sign_out",
    "post /rigs/{rig}/page-check": "check_page",
    "get /audit": "list_audit_entries",
    "get /audit/chain": "check_audit_chain",
    "get /asyncapi.json": "get_asyncapi",
    "get /livez": "check_liveness",
    "get /readyz": "check_readiness",
    "get /metrics": "get_metrics",
    "get /version": "get_version",
}
"""Name of each operation by method and path; generated clients and tools use it."""


def complete(document: dict[str, Any]) -> None:
    """Add models and responses that no route declares, and remove FastAPI's own error model."""
    schemas = document["components"]["schemas"]
    # A job contains the result of any kind, and kinds are registered by plug-ins.
    results = dict.fromkeys(
        [*(one for kind in job_kinds().values() for one in kind.results), JobResult]
    )
    for model in (Problem, *results):
        tree = model.model_json_schema(ref_template=SCHEMAS + "{model}")
        schemas.update(tree.pop("$defs", {}))
        schemas[model.__name__] = tree
    properties = schemas["Job"]["properties"]
    named = [{"$ref": SCHEMAS + model.__name__} for model in results]
    description = properties["result"]["description"]
    properties["result"] = {
        "title": "Result",
        "description": description,
        "anyOf": [*named, {"type": "null"}],
    }
    for unused in ("HTTPValidationError", "ValidationError"):
        schemas.pop(unused, None)
    _name_operations(document)
    for operation in _operations(document):
        for parameter in operation.get("parameters", ()):
            parameter["schema"] = _sent(parameter["schema"])
        if _is_own_error_model(operation["responses"].get("422", {})):
            del operation["responses"]["422"]
        if "requestBody" in operation:
            most_bytes = operation.setdefault(MOST_BYTES, SMALL_BYTES)
            operation["requestBody"]["description"] = f"JSON of at most {most_bytes} bytes"
        for content in operation.get("requestBody", {}).get("content", {}).values():
            operation["responses"].update(
                {str(status): answer for status, answer in responses(400).items()}
            )
            _flatten_union(content["schema"])
        for answer in operation["responses"].values():
            for content in answer.get("content", {}).values():
                if "itemSchema" in content:  # from OpenAPI 3.2, which few tools accept yet
                    content["x-itemSchema"] = content.pop("itemSchema")
    for schema in schemas.values():
        for one in schema.get("examples", ()):
            _add_nulls(one, schema, schemas)
    _add_shared_responses(document)


def _add_nulls(value: Any, schema: dict[str, Any], schemas: dict[str, Any]) -> None:
    """Add the required members of an example that are null, which FastAPI has removed."""
    schema = schemas.get(schema.get("$ref", "").removeprefix(SCHEMAS), schema)
    if isinstance(value, dict):
        members = cast("dict[str, Any]", value)
        for name in schema.get("required", ()):
            members.setdefault(name, None)
        for name, member in schema.get("properties", {}).items():
            _add_nulls(members.get(name), member, schemas)
    elif isinstance(value, list):
        for item in cast("list[Any]", value):
            _add_nulls(item, schema.get("items", {}), schemas)


def _name_operations(document: dict[str, Any]) -> None:
    """Name each operation and summarize it by that name, if it has one in ``OPERATIONS``."""
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            name = OPERATIONS.get(f"{method} {path.removeprefix(BASE)}")
            if name:
                operation["operationId"] = name
                operation["summary"] = name.replace("_", " ").capitalize()


def _sent(schema: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a parameter without null, which a query or header cannot contain."""
    kinds = [kind for kind in schema.get("anyOf", ()) if kind != {"type": "null"}]
    if len(kinds) != 1:
        return schema
    return {name: value for name, value in schema.items() if name != "anyOf"} | kinds[0]


def _placed(document: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    for path, operations in document["paths"].items():
        for operation in operations.values():
            yield path, operation


def _operations(document: dict[str, Any]) -> Iterator[dict[str, Any]]:
    return (operation for _, operation in _placed(document))


def _is_own_error_model(answer: dict[str, Any]) -> bool:
    """Return whether a response was added by FastAPI itself."""
    schema = answer.get("content", {}).get("application/json", {}).get("schema", {})
    return schema.get("$ref") == f"{SCHEMAS}HTTPValidationError"


def _flatten_union(schema: dict[str, Any]) -> None:
    """Replace each nested union by its choices, since many generators do not support nested ones.

    Several choices then have the same value of the discriminator, so the discriminator is removed.
    """
    choices = schema.get("oneOf", ())
    flat = [inner for choice in choices for inner in choice.get("oneOf", [choice])]
    if len(flat) > len(choices):
        schema["oneOf"] = flat
        del schema["discriminator"]


def _add_shared_responses(document: dict[str, Any]) -> None:
    """Add to each operation, by reference, the responses of the middleware before it."""
    document["components"]["responses"] = {
        name: responses(status)[status] for status, name in NAMES.items()
    }
    for path, operation in _placed(document):
        wanted = EVERYWHERE
        if path.endswith(ESTOP):  # an emergency stop accepts any parameters
            wanted = tuple(status for status in wanted if status != 422)
        if "security" in operation or operation["operationId"] == "sign_in":
            wanted += WITH_KEY
        if "requestBody" in operation:
            wanted += WITH_BODY
        for status in wanted:
            reference = {"$ref": f"#/components/responses/{NAMES[status]}"}
            operation["responses"].setdefault(str(status), reference)
        operation.setdefault("security", [])  # routes without a key


VERSIONED = (
    routes_rigs.router,
    routes_job_list.router,
    routes_jobs.router,
    routes_jobs.catalog_router,
    routes_series.router,
    routes_model.calibration_router,
    routes_model.learning_router,
    routes_model.recipe_router,
    routes_rigs.simulation_router,
    routes_trajectories.router,
    routes_events.router,
    routes_events.alarm_router,
    routes_access.router,
)


def create_app(rigs: Rigs, access: Access | None = None) -> FastAPI:
    """Build the application. It has no documentation pages, since they load foreign scripts."""
    app = FastAPI(
        title="pincette supervisor",
        version=__version__,
        description="Plans, runs and records jobs of a piezoelectric microgripper. "
        "Units are in the names: µm, mN, V, s. Errors are problem documents (RFC 9457).",
        license_info={"name": "Apache License 2.0", "identifier": "Apache-2.0"},
        servers=[{"url": "/"}],
        docs_url=None,
        redoc_url=None,
        openapi_url="/openapi.json",
        redirect_slashes=False,
    )
    app.state.rigs = rigs
    app.state.access = access = access or Access()
    problems.install_handlers(app)
    _add_middleware(app, access)
    for router in VERSIONED:
        app.include_router(router, prefix=BASE)
    for router in (routes_page.router, routes_probes.documents, routes_probes.router):
        app.include_router(router)
    generate: Callable[[], dict[str, Any]] = app.openapi

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            tree = generate()
            complete(tree)
            session = tree["components"]["securitySchemes"]["session"]
            session["name"] = cookie_name(access.authenticator.supervisor)
        return generate()

    app.openapi = openapi
    return app


def _add_middleware(app: FastAPI, access: Access) -> None:
    """Add the middleware of all routes; the last one added is outermost."""
    app.add_middleware(HeadAndOptions, routes=app.routes)
    if access.buckets is not None:
        app.add_middleware(
            RateLimit,
            authenticator=access.authenticator,
            buckets=access.buckets,
            clients_per_address=access.clients_per_address,
        )
    app.add_middleware(OriginCheck, names=access.names)
    app.add_middleware(
        AuditLog, authenticator=access.authenticator, audit_buffer=access.audit_buffer
    )
    app.add_middleware(NormalTarget)


def openapi_document() -> str:
    """Return the OpenAPI document as text; no route is called, so no rig is needed."""
    tree = create_app(cast(Rigs, None)).openapi()
    return json.dumps(tree, indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(openapi_document(), encoding="utf-8")
