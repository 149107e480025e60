# SPDX-License-Identifier: Apache-2.0
"""Writing files so that a crash at any moment leaves either the old or the new content."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from comcal.errors import UsageError


def sync_folder(folder: Path) -> None:
    """Make new, renamed and removed names in *folder* survive a power failure."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_atomically(path: Path, data: bytes) -> None:
    """Write *data* to *path*: at any moment there is the old content or the new, never a part.

    Parameters
    ----------
    path : Path
        Replaced if it exists. The temporary file beside it is called ``.<name>.tmp``.
    data : bytes
    """
    temporary = path.with_name(f".{path.name}.tmp")
    with temporary.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)
    sync_folder(path.parent)


def write_new(path: Path, data: bytes) -> None:
    """Write *data* to a file that must not exist yet; a failure leaves none.

    Parameters
    ----------
    path : Path
    data : bytes

    Raises
    ------
    UsageError
        If there is such a file.
    """
    try:
        with path.open("xb") as file:
            try:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            except BaseException:
                path.unlink()
                raise
    except FileExistsError as error:
        raise UsageError(
            "exists already, and nothing is ever overwritten",
            where=str(path),
            next_step="give another name, or move it away",
        ) from error
    sync_folder(path.parent)


def link_atomically(link: Path, target: str) -> None:
    """Point the symbolic link *link* at *target* (relative to its folder), replacing an old one."""
    temporary = link.with_name(f".{link.name}.tmp")
    temporary.unlink(missing_ok=True)
    temporary.symlink_to(target)
    temporary.replace(link)
    sync_folder(link.parent)


def partial_path(path: Path) -> Path:
    """Return the first free ``<name>.partial-N`` beside *path*, N = 1, 2, ..."""
    number = 1
    while (aside := path.with_name(f"{path.name}.partial-{number}")).exists():
        number += 1
    return aside


def move_aside(path: Path) -> Path | None:
    """Rename *path* to ``<name>.partial-N`` if it exists; return the new name."""
    if not path.exists():
        return None
    aside = partial_path(path)
    path.rename(aside)
    sync_folder(path.parent)
    return aside


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file's content, in hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
