"""The router: serves supervisor, recorder and other tools beside the loop's direct links."""

from pincette.bus.links import Ends
from pincette.bus.places import router_place, upstream_place
from pincette.bus.zenoh_bus import serve_router
from pincette.runtime.context import Context
from pincette.runtime.priority import come_first


def run(context: Context) -> None:
    """Route for a rig until stopped."""
    if not context.rig.lockstep:
        come_first(context.rig.realtime.of("router"))
    _route(context, router_place(context.rig), "router")


def run_upstream(context: Context) -> None:
    """Route on a laboratory server, which the router of a rig connects to, until stopped."""
    _route(context, upstream_place(context.rig), "upstream")


def _route(context: Context, ends: Ends, name: str) -> None:

    def wait() -> None:
        context.ready(f"routes at {ends.listen[0]}")
        context.stop.wait()

    serve_router(ends, context.rig.rig.name, wait, name)
