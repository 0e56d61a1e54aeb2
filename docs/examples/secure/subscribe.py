"""Print position, force and voltage of a rig that requires mutual TLS; needs zenoh and msgpack."""
# pyright: basic

import argparse
import json
from contextlib import suppress

import msgpack
import zenoh

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--pki", default="data/pki", help="folder of certificates")
parser.add_argument("--identity", default="viewer", help="whose certificate is shown")
parser.add_argument("--router", default="tls/127.0.0.1:7447")
parser.add_argument("--rig", default="demo")
given = parser.parse_args()
tls = {
    "root_ca_certificate": f"{given.pki}/authority.crt",
    "connect_certificate": f"{given.pki}/{given.identity}.crt",
    "connect_private_key": f"{given.pki}/{given.identity}.key",
    "enable_mtls": True,
}
config = zenoh.Config.from_json5(
    json.dumps(
        {
            "mode": "client",
            "connect": {"endpoints": [given.router]},
            "scouting": {"multicast": {"enabled": False}},
            "transport": {"link": {"protocols": ["tls"], "tls": tls}},
        }
    )
)
with suppress(KeyboardInterrupt), zenoh.open(config) as session:
    messages = session.declare_subscriber(f"pincette/v2/{given.rig}/*")
    for sample in messages:
        topic, m = str(sample.key_expr), msgpack.unpackb(sample.payload.to_bytes())
        if topic.endswith("/estimate"):
            arm = m["arms"][0]
            found = f"{arm['x_um']:8.3f} µm {arm['force_mN']:8.3f} mN"
            print(found if m["valid"] else f"not valid: {m['fault']}", flush=True)
        elif topic.endswith("/applied"):
            found = f"{m['arms'][0]['voltage_V']:8.4f} V"
            print("not confirmed" if m["unconfirmed"] else found, flush=True)
