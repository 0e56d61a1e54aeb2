"""``python -m pincette_study`` runs the command ``pincette paper``, also if it is not installed."""

import sys

import typer

from pincette.cli.main import run
from pincette_study.command import app

if __name__ == "__main__":
    paper = typer.main.get_group(app).commands["paper"]
    sys.exit(run(paper, sys.argv[1:], "pincette paper"))
