"""SUMO floating-car data: the XML, plain or compressed by gzip, for the simulator's reader."""

from __future__ import annotations

import gzip
import zlib
from os import PathLike, fspath
from typing import IO
from xml.parsers import expat

from ._native import Trace, TraceReader

GZIP_MAGIC = b"\x1f\x8b"
"""The first two bytes of every gzip file (RFC 1952, section 2.3.1)."""


def read_trace(path: str | PathLike[str]) -> Trace:
    """The trace in a file of SUMO floating-car data; the file's content says whether it is compressed, not its name.

    Raises:
        OSError: a file that cannot be read.
        ValueError: a file that makes no sense, with its line.
    """
    name = fspath(path)
    with open(path, "rb") as file:
        compressed = file.peek(2)[:2] == GZIP_MAGIC
        if not compressed:
            return _parse(name, file)
        with gzip.open(file) as content:
            return _parse(name, content)


def mobility_of(mobility: str | PathLike[str] | Trace) -> Trace | None:
    """What moves the vehicles: a trace, or with "grid" None."""
    if isinstance(mobility, Trace):
        return mobility
    return None if mobility == "grid" else read_trace(mobility)


def _parse(name: str, file: IO[bytes] | gzip.GzipFile) -> Trace:
    reader = TraceReader(name)
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda tag, attributes: reader.open(parser.CurrentLineNumber, tag, attributes)
    parser.EndElementHandler = lambda _: reader.close()
    parser.CharacterDataHandler = lambda text: reader.text(parser.CurrentLineNumber, text)
    try:
        parser.ParseFile(file)
    except expat.ExpatError as error:
        found = f"broken XML ({expat.ErrorString(error.code)})"
        raise ValueError(f"{name}:{error.lineno}: found {found}, expected well-formed XML") from None
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        place = f"{name}:{parser.CurrentLineNumber}"
        raise ValueError(f"{place}: found unreadable data ({error}), expected a whole, undamaged file") from None
    return reader.finish(parser.CurrentLineNumber)
