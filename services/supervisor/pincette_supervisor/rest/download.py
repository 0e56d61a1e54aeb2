"""Downloads whose parts are generated while they are sent."""

from collections.abc import Callable, Iterator

from anyio import CancelScope
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import StreamingResponse
from starlette.types import Receive, Scope, Send


class Download(StreamingResponse):
    """Attachment that ends its generator when it has been sent, or when its client disconnects.

    Otherwise the files that the generator reads would stay open until the garbage collector runs.
    """

    def __init__(self, parts: Iterator[str | bytes], media_type: str, name: str) -> None:
        """Prepare a download that is saved under a name."""
        headers = {"Content-Disposition": f'attachment; filename="{name}"'}
        super().__init__(parts, media_type=media_type, headers=headers)
        self._close: Callable[[], None] | None = getattr(parts, "close", None)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the parts."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            if self._close is not None:
                with CancelScope(shield=True):
                    await run_in_threadpool(self._close)
