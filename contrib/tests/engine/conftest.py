"""Tests in containers that drive adapters with stock clients; `make engine` runs them."""

from tests.engine.conftest import an_engine, pytest_collection_modifyitems, stalls

__all__ = ["an_engine", "pytest_collection_modifyitems", "stalls"]
