# SPDX-License-Identifier: Apache-2.0
"""Reading and writing ``session.yaml``."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import cast

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from comcal.errors import ConfigError
from comcal.measure.files import write_atomically

Metadata = dict[str, object]


def read_metadata(path: Path, expected_format: str) -> Metadata:
    """Return the content of ``session.yaml``.

    Parameters
    ----------
    path : Path
    expected_format : str
        What its entry ``format`` must be.

    Raises
    ------
    ConfigError
        If it cannot be read, is not YAML, or is of another format.
    """
    try:
        content: object = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, YAMLError, ValueError) as problem:
        raise ConfigError(
            f"cannot be read: {str(problem).splitlines()[0]}",
            where=str(path),
            next_step="restore it from a copy",
        ) from problem
    found = cast("Metadata", content) if isinstance(content, dict) else {}
    if found.get("format") != expected_format:
        raise ConfigError(
            "is not a session of this version",
            where=str(path),
            measured=f"format {found.get('format')}",
            limit=expected_format,
            next_step="open it with the version of comcal that wrote it",
        )
    return found


def write_metadata(path: Path, entries: Mapping[str, object]) -> None:
    """Replace ``session.yaml`` atomically.

    Parameters
    ----------
    path : Path
    entries : mapping
        Maps, lists, words, numbers and booleans only; written in this order.
    """
    yaml = YAML(pure=True)
    yaml.width = 4096
    stream = io.BytesIO()
    yaml.dump(dict(entries), stream)
    write_atomically(path, stream.getvalue())


def as_mapping(value: object) -> dict[object, object]:
    """Return *value* if it is a map, else an empty one: an entry of a file may be anything."""
    return cast("dict[object, object]", value) if isinstance(value, dict) else {}
