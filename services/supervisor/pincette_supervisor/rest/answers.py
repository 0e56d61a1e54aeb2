"""What the OpenAPI document says of answers that any route may give."""

from typing import Any

from pincette.api.problem_models import responses

NAMES = {
    401: "NoKey",
    403: "NotAllowed",
    408: "BodyTooSlow",
    413: "BodyTooLarge",
    421: "ForeignHost",
    429: "TooManyRequests",
    503: "Busy",
}
EVERYWHERE, WITH_KEY, WITH_BODY = (403, 421, 429, 503), (401,), (408, 413)


def complete_answers(document: dict[str, Any]) -> None:
    """Say of each operation what stands before it may answer, in words that stand once."""
    document["components"]["responses"] = {
        name: responses(status)[status] for status, name in NAMES.items()
    }
    for operations in document["paths"].values():
        for operation in operations.values():
            wanted = EVERYWHERE
            if "security" in operation or operation["operationId"].startswith("sign_in"):
                wanted += WITH_KEY
            if "requestBody" in operation:
                wanted += WITH_BODY
            for status in wanted:
                reference = {"$ref": f"#/components/responses/{NAMES[status]}"}
                operation["responses"].setdefault(str(status), reference)
