"""Bodies, content types and paths that no client sends on purpose."""

GRIP = '"kind": "grip", "dry_run": true'
MANY = [f'"f{number}": "b"' for number in range(5000)]
BODIES: dict[str, bytes] = {
    "nothing": b"",
    "null": b"null",
    "a number": b"1",
    "a text": b'"grip"',
    "lists in lists": b"[" * 100_000,
    "lists in lists that end": b"[" * 50_000 + b"]" * 50_000,
    "maps in maps": b'{"a":' * 50_000,
    "depth in a field": f'{{{GRIP}, "labels": {"[" * 900}{"]" * 900}}}'.encode(),
    "depth in gains": f'{{{GRIP}, "gains": {"{" + chr(34) + "K_P" + chr(34) + ":"}'.encode() * 300,
    "beyond a float": f'{{{GRIP}, "force_mN": 1e309}}'.encode(),
    "far below zero": f'{{{GRIP}, "force_mN": -1e309}}'.encode(),
    "NaN": f'{{{GRIP}, "force_mN": NaN}}'.encode(),
    "Infinity": f'{{{GRIP}, "hold_s": Infinity}}'.encode(),
    "minus Infinity": f'{{{GRIP}, "load_s": -Infinity}}'.encode(),
    "subnormal": f'{{{GRIP}, "force_mN": 5e-324}}'.encode(),
    "subnormal hold": f'{{{GRIP}, "hold_s": 5e-324}}'.encode(),
    "large and finite": f'{{{GRIP}, "force_mN": 1e308}}'.encode(),
    "largest contact": f'{{{GRIP}, "contact_force_mN": 1.7e308}}'.encode(),
    "a long number": f'{{{GRIP}, "force_mN": {"9" * 5000}}}'.encode(),
    "a longer number": f'{{{GRIP}, "force_mN": {"9" * 400}}}'.encode(),
    "a long fraction": f'{{{GRIP}, "force_mN": 0.{"3" * 100_000}}}'.encode(),
    "true for a number": f'{{{GRIP}, "force_mN": true}}'.encode(),
    "broken UTF-8": b'{"kind": "gr\xff\xfeip"}',
    "overlong UTF-8": b'{"kind": "gr\xc0\xafip"}',
    "half a pair": rb'{"kind": "\ud800"}',
    "half a pair in a label": f'{{{GRIP}, "labels": {{"part": "{chr(92)}ud800"}}}}'.encode(),
    "half a pair in a rig": f'{{{GRIP}, "rig": "{chr(92)}udfff"}}'.encode(),
    "half a pair in a field": f'{{{GRIP}, "{chr(92)}ud800": 1}}'.encode(),
    "NUL": b'{"kind": "grip\x00"}',
    "NUL in a label": f'{{{GRIP}, "labels": {{"part": "{chr(92)}u0000"}}}}'.encode(),
    "a mark at the start": b"\xef\xbb\xbf{" + GRIP.encode() + b"}",
    "UTF-16": f"{{{GRIP}}}".encode("utf-16"),
    "UTF-32": f"{{{GRIP}}}".encode("utf-32"),
    "two documents": f"{{{GRIP}}}{{{GRIP}}}".encode(),
    "many fields": f"{{{GRIP}, {', '.join(MANY)}}}".encode(),
    "many labels": f'{{{GRIP}, "labels": {{{", ".join(MANY)}}}}}'.encode(),
    "a long label": f'{{{GRIP}, "labels": {{"part": "{"x" * 5000}"}}}}'.encode(),
    "a label's odd name": f'{{{GRIP}, "labels": {{"a{chr(92)}r{chr(92)}nb": "x"}}}}'.encode(),
    "a field that is a class's": f'{{{GRIP}, "__class__": "x", "model_config": {{}}}}'.encode(),
}  # fmt: skip
"""Bodies of a request for a job."""
TYPES: tuple[bytes | None, ...] = (
    None, b"", b"text/plain", b"application/x-www-form-urlencoded", b"multipart/form-data",
    b"multipart/form-data; boundary=x", b"application/msgpack", b"application/json; charset=utf-7",
    b"application/json\r\nx-evil: 1", b"\xff\xfe", b"application/vnd.api+json", b"a/b/c",
    b"x" * 9999,
)  # fmt: skip
TRAVERSALS = (
    "..", "../..", "..%2f..", "%2e%2e%2f%2e%2e", "..%252f..", "....//", "%00", "a%00.png", "..%00",
    "%5c..%5c", "C:%5c", "%2fetc%2fpasswd", "//etc/passwd", "manifest.json%00.png", "%ff%fe",
    "%f0%9f%98%80", "%e2%80%ae", "x" * 5000, "%", "%zz", ".", "...", "~", "$HOME", "%0d%0aX-Evil:1",
    "samples.parquet/..", "manifest.json%2f..%2fjob.mcap", "<script>", "*", "nul", "%7f",
)  # fmt: skip
PLACES = (
    "/api/v1/jobs/{}", "/api/v1/jobs/{}/artifacts", "/api/v1/jobs/{job}/artifacts/{}",
    "/api/v1/jobs/{}/artifacts/manifest.json", "/api/v1/jobs/{}/events/list",
    "/api/v1/trajectories/{}", "/api/v1/trajectories/{}/samples.csv",
    "/api/v1/trajectories/{}/plot", "/api/v1/recipes/{}", "/api/v1/recipes/{}/1",
    "/api/v1/recipes/bead/{}", "/api/v1/rigs/{}", "/api/v1/rigs/{}/model",
    "/api/v1/calibrations/{}",
    "/page/{}", "/{}", "/api/{}/jobs", "/?rig={}", "/api/v1/jobs?label={}",
    "/api/v1/jobs?before={}",
    "/api/v1/jobs?rig={}", "/api/v1/jobs/{job}?since={}", "/api/v1/jobs?limit={}",
)  # fmt: skip
FILES = ("/api/v1/jobs/{job}/artifacts/{}", "/api/v1/trajectories/{}/plot", "/page/{}", "/{}")
"""Parameters from which the path of a file is made."""
RECIPES: dict[str, str] = {
    "depth": '{"force_mN": ' + "[" * 500 + "]" * 500 + "}",
    "not finite": '{"force_mN": 1e309}',
    "NaN": '{"part": {"contact_um": NaN}}',
    "unknown": '{"colour": 1}',
    "half a pair": '{"shape": "\\ud800"}',
    "a field that is none": '{"": 1}',
    "gains in gains": '{"gains": {"gains": {"gains": "tuned"}}}',
    "kind": '{"kind": "move"}',
    "a list": "[1]",
    "its own name": '{"recipe": "a", "labels": {"a": "b"}}',
}
"""Invalid values of a recipe, as JSON."""
