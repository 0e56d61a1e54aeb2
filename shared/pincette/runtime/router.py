"""The router: serves supervisor, recorder and other tools beside the loop's direct links."""

from pincette.bus.places import router_place
from pincette.bus.zenoh_bus import serve_router
from pincette.runtime.context import Context
from pincette.runtime.priority import come_first


def run(context: Context) -> None:
    """Route until stopped."""
    if not context.rig.lockstep:
        come_first()
    ends = router_place(context.rig)

    def wait() -> None:
        context.ready(f"routes at {ends.listen[0]}")
        context.stop.wait()

    serve_router(ends, context.rig.rig.name, wait)
