"""Functions of floats and flat records, compiled as they stand: one statement, two speeds."""

from pincette_batch.compiling.compiler import (
    CompilerMissingError,
    available,
    compiled,
    of_the_library,
)
from pincette_batch.compiling.records import as_record, as_structure, record_type

__all__ = [
    "CompilerMissingError",
    "as_record",
    "as_structure",
    "available",
    "compiled",
    "of_the_library",
    "record_type",
]
