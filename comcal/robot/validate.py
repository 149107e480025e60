# SPDX-License-Identifier: Apache-2.0
"""Validation of a located YAML file: every refusal names file, line and the key probably meant."""

from __future__ import annotations

import types
from collections.abc import Sequence
from difflib import get_close_matches
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from comcal.errors import ComcalError, ConfigError
from comcal.robot.locate import Key, LocatedYaml

Model = TypeVar("Model", bound=BaseModel)


def validate_file(located: LocatedYaml, model: type[Model]) -> Model:
    """Check *located* against *model*.

    Parameters
    ----------
    located : LocatedYaml
    model : type of BaseModel

    Returns
    -------
    BaseModel
        An instance of *model*.

    Raises
    ------
    ConfigError
        For the first mistake in the file; unknown keys come first, because a misspelt key is the
        usual reason for a missing one.
    """
    # A known key without a value (`sensors:`) counts as if the line were not there.
    given = {
        key: value
        for key, value in located.data.items()
        if value is not None or key not in model.model_fields
    }
    try:
        return model.model_validate(given)
    except ValidationError as error:
        details = error.errors(include_url=False)

    def order(detail: ErrorDetails) -> tuple[bool, int]:
        return detail["type"] != "extra_forbidden", located.line(detail["loc"])

    raise _located(located, model, min(details, key=order))


def did_you_mean(name: str, known: Sequence[str]) -> str:
    """Return a suggestion in words: the nearest known name, else all of them if they are few."""
    close = get_close_matches(name, known, n=1)
    if close:
        return f"did you mean {close[0]!r}?"
    return f"possible are {', '.join(known)}" if 0 < len(known) <= 20 else ""


def _located(located: LocatedYaml, model: type[BaseModel], detail: ErrorDetails) -> ConfigError:
    """Return one of pydantic's complaints as an error with file and line."""
    path = _in_file(located, detail["loc"], keep_last=detail["type"] == "missing")
    where = located.where(*path)
    name = _dotted(path)
    if detail["type"] == "extra_forbidden":
        section = _dotted(path[:-1])
        return ConfigError(
            f"unknown key {str(path[-1])!r}" + (f" in {section}" if section else ""),
            where=where,
            next_step=did_you_mean(str(path[-1]), _keys_at(model, path[:-1])),
        )
    if detail["type"] == "missing":
        section = _dotted(path[:-1])
        return ConfigError(
            f"key {str(path[-1])!r} is missing" + (f" in {section}" if section else ""),
            where=where,
        )
    cause = detail.get("ctx", {}).get("error")
    if isinstance(cause, ComcalError):
        return ConfigError(
            f"{name}: {cause.what}" if name else cause.what,
            where=where,
            measured=cause.measured,
            limit=cause.limit,
            next_step=cause.next_step,
        )
    message = detail["msg"].replace("Input should be", "must be")
    got = repr(detail["input"])
    return ConfigError(
        f"{name}: {message[:1].lower()}{message[1:]}",
        where=where,
        measured=f"got {got if len(got) <= 60 else got[:57] + '...'}",
    )


def _in_file(located: LocatedYaml, loc: tuple[Key, ...], *, keep_last: bool) -> tuple[Key, ...]:
    """Return what of pydantic's *loc* are keys of the file; a missing key is the last of them."""
    path: list[Key] = []
    for part in loc:
        if (*path, part) in located.lines:
            path.append(part)
    if keep_last:
        path.append(loc[-1])
    return tuple(path)


def _dotted(path: Sequence[Key]) -> str:
    """Return ``sensors.l_foot.joint`` or ``sole[2]``."""
    text = ""
    for key in path:
        text += f"[{key}]" if isinstance(key, int) else f".{key}" if text else key
    return text


def _keys_at(model: type[BaseModel], path: Sequence[Key]) -> list[str]:
    """Return the keys that the section at *path* knows."""
    kind: Any = model
    for key in path:
        section = _as_section(kind)
        if section is not None:
            field = section.model_fields.get(str(key))
            kind = None if field is None else field.annotation
        else:
            arguments = get_args(_plain(kind))
            kind = arguments[-1] if arguments else None
    section = _as_section(kind)
    return [] if section is None else list(section.model_fields)


def _as_section(kind: Any) -> type[BaseModel] | None:
    """Return the model that *kind* stands for, None where it is something else."""
    kind = _plain(kind)
    # Python 3.10 takes list[int] for a class, but it cannot be asked for its parents.
    is_class = isinstance(kind, type) and get_origin(kind) is None
    return kind if is_class and issubclass(kind, BaseModel) else None


def _plain(kind: Any) -> Any:
    """Strip ``Annotated`` and ``| None`` from a type."""
    while True:
        origin = get_origin(kind)
        if origin is Annotated:
            kind = get_args(kind)[0]
        elif origin is Union or origin is types.UnionType:
            kind = next(k for k in get_args(kind) if k is not type(None))
        else:
            return kind
