#!/usr/bin/env bash
# ser2net's `chardelay` waits as long at 115200 baud as at 9600 baud.
#
# One would expect: ser2net waits for two characters before it sends (its manual: "normally ser2net will
# wait the time it takes to receive 2 serial port characters, or at least 1000us"), which is 0.17 ms at
# 115200 baud, so 1 ms.
# What happens: it waits for two characters at 9600 baud at any rate, rounded up to whole milliseconds.
# Its function that reads the rate out of the port's description looks for digits at the comma before
# them, finds none, and takes 9600 baud. An answer comes 3 ms late at the defaults. A request and answer
# in each period of 20 ms lose a sixth of it for nothing.
# Seen with ser2net 4.3.11 of Debian 12, median of 100 echoes over a pseudo-terminal:
#   9600 baud 3.1 ms, 115200 baud 3.1 ms, 115200 baud with chardelay: false 0.1 ms
# The remedy is `chardelay: false` in the options of the connection.
set -euo pipefail
export PATH="$PATH:/usr/sbin"
if ! command -v ser2net > /dev/null; then
  echo "needs ser2net: apt-get install ser2net" >&2
  exit 1
fi
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 - "$folder" <<'PYTHON'
import os
import pty
import socket
import statistics
import subprocess
import sys
import threading
import time
import tty

FOLDER = sys.argv[1]


def late_ms(baud, options):
    """Return the median time from a request to its echo through ser2net, in ms."""
    controller, terminal = pty.openpty()
    tty.setraw(controller)
    threading.Thread(target=echo, args=[controller], daemon=True).start()
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    path = f"{FOLDER}/{baud}{len(options)}.yaml"
    with open(path, "w") as file:
        file.write(
            "%YAML 1.1\n---\nconnection: &port\n"
            f"  accepter: tcp(nodelay=true),127.0.0.1,{port}\n"
            f"  connector: serialdev,{os.ttyname(terminal)},{baud}n81,local\n" + options
        )
    server = subprocess.Popen(["ser2net", "-n", "-c", path, "-P", f"{path}.pid"])
    try:
        client = connected(port)
        took_s = []
        for _ in range(100):
            began_s = time.perf_counter()
            client.sendall(b"?")
            client.recv(1)
            took_s.append(time.perf_counter() - began_s)
        client.close()
    finally:
        server.terminate()
        server.wait()
    return 1e3 * statistics.median(took_s)


def echo(controller):
    while True:
        os.write(controller, os.read(controller, 64))


def connected(port):
    for _ in range(100):
        try:
            return socket.create_connection(("127.0.0.1", port), timeout=5.0)
        except OSError:
            time.sleep(0.05)
    sys.exit("ser2net does not listen")


slow = late_ms(9600, "")
fast = late_ms(115200, "")
off = late_ms(115200, "  options:\n    chardelay: false\n")
print(f"9600 baud {slow:.1f} ms, 115200 baud {fast:.1f} ms, 115200 baud with chardelay: false {off:.1f} ms")
if not (fast - off > 2.0 and abs(fast - slow) < 1.0):
    sys.exit("no longer as described")
PYTHON
