# SPDX-License-Identifier: Apache-2.0
"""The frames of a session on disk: ``can/``, one log for every attempt at a pose.

::

    can/start.log           what was said before the first pose
    can/pose_007.log        the first attempt at pose 7; later ones pose_007.2.log, ...
    can/devices.json        what the devices told of themselves: matrix, serial, rated current
"""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from comcal.errors import DataError, HardwareError
from comcal_drivers.devices.commands import DeviceValues
from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.frames.frame_log import FrameLog
from comcal_drivers.frames.logs import read_log

FOLDER = "can"
DEVICES = "devices.json"


class SessionLog:
    """Where raw frames go; a new file for everything that begins.

    Parameters
    ----------
    directory : Path or None
        Session folder; None: frames are kept nowhere.

    Raises
    ------
    HardwareError
        If the disk does not take the files.
    """

    def __init__(self, directory: Path | None) -> None:
        self._folder = None if directory is None else directory / FOLDER
        self._file: FrameLog | None = None
        logs = [] if self._folder is None else sorted(self._folder.glob("*.log"))
        self.origin = min(filter(np.isfinite, map(first_stamp, logs)), default=None)
        """Stamp of the first frame that was ever kept here [s]: time zero of the session."""
        # The readers of several buses write while the recorder begins the next file.
        self._lock = threading.Lock()

    def begin(self, name: str) -> None:
        """Write what comes from now on to ``can/<name>.log``, or the next free number of it."""
        if self._folder is None:
            return
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _full(self._folder, error) from error
        new = FrameLog(_free(self._folder, name, ".log"))
        with self._lock:
            old, self._file = self._file, new
        if old is not None:
            old.close()

    def write(self, batch: FrameBatch, channel: str) -> None:
        """Append frames; before anything began they are not kept."""
        with self._lock:
            if self._file is not None:
                self._file.write(batch, channel)
                if self.origin is None and len(batch):
                    self.origin = float(batch.t[0])

    def tell(
        self, told: Mapping[str, DeviceValues], facts: Mapping[str, Mapping[str, object]]
    ) -> None:
        """Keep what the devices told, in a new file each time; *facts*: who they are besides."""
        if self._folder is None or not (any(told.values()) or facts):
            return
        stem, _, ending = DEVICES.partition(".")
        try:
            path = _free(self._folder, stem, f".{ending}")
            content = {"told": told, "facts": facts}
            path.write_text(json.dumps(content, indent=1) + "\n", "utf-8")
        except OSError as error:
            raise _full(self._folder, error) from error

    def close(self) -> None:
        """Close the newest file."""
        with self._lock:
            old, self._file = self._file, None
        if old is not None:
            old.close()


def first_stamp(path: Path) -> float:
    """Return the stamp of the first frame of a log [s]; infinite where there is none."""
    if path.stat().st_size == 0:
        return np.inf
    for batch in read_log(path, 1):
        return float(batch.t[0])
    return np.inf


def devices_told(folder: Path) -> dict[str, DeviceValues]:
    """Return what devices told when the logs in *folder* were written, newest wins.

    Raises
    ------
    DataError
        If a file is not what was written.
    """
    found: dict[str, DeviceValues] = {}
    stem, _, ending = DEVICES.partition(".")
    for path in _numbered(folder, stem, f".{ending}"):
        try:
            content = json.loads(path.read_text("utf-8"))
            for name, values in content["told"].items():
                found[name] = {
                    key: tuple(value) if isinstance(value, list) else value
                    for key, value in values.items()
                }
        except (ValueError, KeyError, AttributeError) as error:
            raise DataError(
                f"what the devices told cannot be read: {error}",
                where=str(path),
                next_step="put the file back as it was recorded, or move it away and give matrix "
                "and full scales in robot.yaml",
            ) from error
    return found


def _free(folder: Path, name: str, ending: str) -> Path:
    path, n = folder / f"{name}{ending}", 1
    while path.exists():
        n += 1
        path = folder / f"{name}.{n}{ending}"
    return path


def _numbered(folder: Path, name: str, ending: str) -> Iterator[Path]:
    """Yield the files that :func:`_free` has given a name, in that order."""
    path, n = folder / f"{name}{ending}", 1
    while path.exists():
        yield path
        n += 1
        path = folder / f"{name}.{n}{ending}"


def _full(folder: Path, error: OSError) -> HardwareError:
    return HardwareError(
        f"the frames cannot be kept: {error.strerror}",
        where=str(folder),
        next_step="make room on the disk, or give a folder that can be written to",
    )
