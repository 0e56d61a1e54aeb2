"""Fetch the samples of a finished job as CSV over REST; needs only Python.

Lines that begin with # describe the samples, and the meaning of each column. Without a job, the
newest one that has ended is used.
"""
# pyright: basic

import argparse
import json
import shutil
import sys
import urllib.error
import urllib.request

ENDED = ("succeeded", "stopped", "aborted", "failed", "interrupted")

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("job", nargs="?")
parser.add_argument("--api", default="http://127.0.0.1:8000/api/v1")
parser.add_argument("--file", help="file to write; standard output if not given")
given = parser.parse_args()


def fetch(path):
    """Open a resource; an error of the supervisor is printed with the supervisor's text."""
    try:
        return urllib.request.urlopen(f"{given.api}{path}", timeout=30.0)
    except urllib.error.HTTPError as error:
        problem = json.load(error)
        raise SystemExit(f"{problem['title']}: {problem['detail']}") from error
    except urllib.error.URLError as error:
        raise SystemExit(f"no supervisor at {given.api}: {error.reason}") from error


job = given.job
if job is None:
    with fetch("/jobs") as answer:
        ended = [job for job in json.load(answer)["jobs"] if job["state"] in ENDED]
    if not ended:
        raise SystemExit("no job has ended yet")
    job = ended[0]["id"]
with fetch(f"/jobs/{job}/artifacts/samples.csv") as answer:
    if given.file is None:
        shutil.copyfileobj(answer, sys.stdout.buffer)
    else:
        with open(given.file, "wb") as file:  # noqa: PTH123
            shutil.copyfileobj(answer, file)
        print(f"{job}: {given.file}")
