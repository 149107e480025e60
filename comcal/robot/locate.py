# SPDX-License-Identifier: Apache-2.0
"""YAML files as plain Python data that still knows on which line each key stands.

YAML 1.2, so ``1e-3`` is a number and ``on`` is a word. Only maps, lists and plain scalars are
understood: tags, duplicate keys and self-containing aliases are refused with their line.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from comcal.errors import ConfigError

Key = str | int
KeyPath = tuple[Key, ...]

_MOST_NODES = 100_000
_DEEPEST = 30
_PREFIX = "tag:yaml.org,2002:"
_WORDS = {"str", "timestamp", "merge", "value"}


@dataclass(frozen=True)
class LocatedYaml:
    """The content of a YAML file and where each part of it stands.

    Parameters
    ----------
    path : Path
    data : dict
        Maps, lists, strings, numbers, booleans and None.
    lines : mapping from key path to int
        Line (from 1) of every key and list item, such as ``("sensors", "l_foot", "joint")``.
    """

    path: Path
    data: dict[str, Any]
    lines: Mapping[KeyPath, int]

    def where(self, *path: Key) -> str:
        """Return ``file:line`` of a key; of its nearest parent where the key itself is missing."""
        return f"{self.path.name}:{self.line(path)}"

    def line(self, path: Sequence[Key]) -> int:
        """Return the line of a key, or of its nearest parent that exists."""
        for end in range(len(path), 0, -1):
            if tuple(path[:end]) in self.lines:
                return self.lines[tuple(path[:end])]
        return 1


def read_yaml(path: Path) -> LocatedYaml:
    """Read a YAML file whose top level is a map.

    Parameters
    ----------
    path : Path

    Raises
    ------
    ConfigError
        If the file is missing, not UTF-8, not YAML, empty, or not a map; if a key occurs twice.
    """
    text = _read_text(path)
    if text.lstrip().startswith("<"):
        raise ConfigError(
            "this is XML, not YAML",
            where=f"{path.name}:1",
            next_step="give the robot.yaml that names this file as its `urdf`",
        )
    node = _compose(text, path.name)
    reader = _Reader(path.name)
    if not isinstance(node, MappingNode):
        empty = node is None
        raise ConfigError(
            "the file is empty" if empty else "the file does not hold `key: value` lines",
            where=f"{path.name}:1",
            next_step="start with `format: comcal-robot/1`",
        )
    data = cast("dict[str, Any]", reader.value(node, ()))
    return LocatedYaml(path, data, reader.lines)


def _read_text(path: Path) -> str:
    """Return the text of a file, refusing what is no text with the line of the first bad byte."""
    try:
        raw = path.read_bytes() if path.is_file() else None
    except OSError as error:
        raise ConfigError(f"cannot be read: {error.strerror}", where=str(path)) from error
    if raw is None:
        raise ConfigError(
            "is a folder, not a file" if path.is_dir() else "there is no such file",
            where=str(path),
            next_step="check the path; the README shows a robot.yaml to start from",
        )
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise ConfigError(
            f"byte 0x{raw[error.start]:02x} is not UTF-8 text",
            where=f"{path.name}:{line}",
            next_step="save the file as UTF-8",
        ) from error


def _compose(text: str, name: str) -> Node | None:
    """Parse YAML into nodes with marks; nothing is constructed, so nothing can be executed."""
    try:
        return cast("Node | None", YAML(typ="safe", pure=True).compose(text))
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        raise ConfigError(
            f"not valid YAML: {error.problem or error.context}",
            where=f"{name}:{mark.line + 1 if mark else 1}",
            next_step="indent with blanks, never tabs" if "\\t" in str(error.problem) else "",
        ) from error
    except YAMLError as error:
        position = getattr(error, "position", 0)
        raise ConfigError(
            "not valid YAML: the text has characters that YAML forbids",
            where=f"{name}:{text.count(chr(10), 0, position) + 1}",
        ) from error
    except RecursionError as error:
        raise ConfigError("nested too deeply to be a description", where=f"{name}:1") from error
    except Exception as error:
        # The scanner meets malformed directives and escapes with ValueError, IndexError and others.
        raise ConfigError("not valid YAML", where=f"{name}:1") from error


class _Reader:
    """Turns nodes into plain data, remembering the line of each key path."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.lines: dict[KeyPath, int] = {}
        self.count = 0

    def value(self, node: Node, path: KeyPath) -> object:
        """Return the plain value of *node*, found at *path*."""
        self.count += 1
        if self.count > _MOST_NODES or len(path) > _DEEPEST:
            raise self.error(node, "too long or too deeply nested; does an alias hold itself?")
        if isinstance(node, MappingNode):
            self.expect_tag(node, {"map"})
            return self.mapping(node, path)
        if isinstance(node, SequenceNode):
            self.expect_tag(node, {"seq"})
            items: list[object] = []
            for i, item in enumerate(cast("list[Node]", node.value)):
                here = (*path, i)
                self.lines[here] = _line(item)
                items.append(self.value(item, here))
            return items
        return self.scalar(node)

    def mapping(self, node: MappingNode, path: KeyPath) -> dict[str, object]:
        """Return a map with its keys as text; a motor may well be called ``1``."""
        result: dict[str, object] = {}
        for key_node, value_node in cast("list[tuple[Node, Node]]", node.value):
            if not isinstance(key_node, ScalarNode):
                raise self.error(key_node, "a key must be a word")
            key = str(key_node.value)
            here = (*path, key)
            if key in result:
                raise self.error(
                    key_node,
                    f"key {key!r} occurs twice, first in line {self.lines[here]}",
                    next_step="remove one of them",
                )
            self.lines[here] = _line(key_node)
            result[key] = self.value(value_node, here)
        return result

    def scalar(self, node: Node) -> object:
        """Return a string, number, boolean or None, as YAML 1.2 reads it."""
        text = str(node.value)
        kind = self.expect_tag(node, {"null", "bool", "int", "float"} | _WORDS)
        if kind == "null":
            return None
        if kind == "bool":
            return text.lower() in {"true", "yes", "on"}
        try:
            if kind == "int":
                return int(text.replace("_", ""), 0 if text.lstrip("+-")[:2] in _BASES else 10)
            if kind == "float":
                return float(
                    text.replace("_", "").lower().replace(".inf", "inf").replace(".nan", "nan")
                )
        except ValueError:
            raise self.error(node, f"{text[:40]!r} is not a number") from None
        return text

    def expect_tag(self, node: Node, allowed: set[str]) -> str:
        """Return the YAML type of *node*, refusing tags such as ``!!binary`` or ``!include``."""
        tag = str(node.tag)
        kind = tag[len(_PREFIX) :] if tag.startswith(_PREFIX) else tag
        if kind not in allowed:
            raise self.error(node, f"the tag {tag!r} has no meaning here", next_step="remove it")
        return kind

    def error(self, node: Node, what: str, next_step: str = "") -> ConfigError:
        """Return the error *what* at the place of *node*."""
        return ConfigError(what, where=f"{self.name}:{_line(node)}", next_step=next_step)


_BASES = {"0x", "0X", "0o", "0O", "0b", "0B"}


def _line(node: Node) -> int:
    """Return the line of a node, counted from 1."""
    mark = node.start_mark
    return int(mark.line) + 1 if mark is not None else 1
