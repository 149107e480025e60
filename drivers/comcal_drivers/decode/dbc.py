# SPDX-License-Identifier: Apache-2.0
"""Read the files that describe messages."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from comcal.errors import ConfigError, MissingExtraError

if TYPE_CHECKING:
    from cantools.database.can import Database


def read_dbc(path: Path | str) -> Database:
    """Read a DBC file, or another format of message descriptions that cantools knows.

    Parameters
    ----------
    path : path
        DBC, KCD, SYM or ARXML.

    Returns
    -------
    cantools.database.can.Database

    Raises
    ------
    ConfigError
        If there is no such file, or it does not describe messages.
    MissingExtraError
        If cantools is not installed.
    """
    try:
        from cantools.database import load_file
        from cantools.database.can import Database
        from cantools.database.errors import Error
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            "CAN messages are decoded by the package cantools, which is not installed",
            where=str(path),
            next_step="type: pip install 'comcal[can]'",
        ) from error
    try:
        database = load_file(Path(path), strict=True)
    except OSError as error:
        raise ConfigError(
            f"the description of messages cannot be read: {error.strerror}",
            where=str(path),
            next_step="name an existing DBC file",
        ) from error
    except (Error, ValueError, KeyError) as error:
        raise ConfigError(
            f"the description of messages is not valid: {error}",
            where=str(path),
            next_step="open it with a DBC editor and mend the line named",
        ) from error
    if not isinstance(database, Database):
        raise ConfigError(
            "the file describes diagnostics, not messages",
            where=str(path),
            next_step="name a DBC, KCD, SYM or ARXML file",
        )
    return database
