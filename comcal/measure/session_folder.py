# SPDX-License-Identifier: Apache-2.0
"""The session folder: one experiment, written so that a crash at any moment loses nothing.

- ``session.yaml`` and the header of ``poses.csv`` appear whole or not at all (written beside,
  synced, renamed); a row of ``poses.csv`` is one appended line, synced.
- A line that was cut off is recognised by its missing line end. The next writer moves it to
  ``poses.csv.partial-N``; readers never see it as a pose.
- Only one writer at a time: a lock of the kernel on ``.lock``, which vanishes with its process.
- Nothing is overwritten. A pose measured again gets a row of its own under a new id; the old id
  is then listed in ``superseded`` of session.yaml, and readers drop it with a note.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Collection, Generator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from comcal.errors import ConfigError, UsageError
from comcal.measure.files import link_atomically, sha256_of, sync_folder
from comcal.measure.rows import append_row, column_numbers, repair_tail
from comcal.measure.session_yaml import Metadata, as_mapping, read_metadata, write_metadata
from comcal.robot.tree import Array

FORMAT = "comcal-session/1"
LOCK = ".lock"


class Session:
    """A session folder that exists; made by :mod:`comcal.measure.session`.

    Parameters
    ----------
    directory : Path
    """

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self._is_locked = False
        self._known: Metadata | None = None  # session.yaml, while nobody else may change it

    @property
    def robot_yaml(self) -> Path:
        """The frozen description of the robot."""
        return self.directory / "robot.yaml"

    @property
    def poses_csv(self) -> Path:
        """The pose table; absent until the first pose is finished."""
        return self.directory / "poses.csv"

    @property
    def session_yaml(self) -> Path:
        """What is known about the experiment."""
        return self.directory / "session.yaml"

    @property
    def is_handmade(self) -> bool:
        """Whether ``poses.csv`` lies beside a robot.yaml where no writer of ours ever was."""
        ours = (self.session_yaml, self.directory / LOCK)
        needed = (self.robot_yaml, self.poses_csv)
        return all(p.is_file() for p in needed) and not any(p.exists() for p in ours)

    @property
    def metadata(self) -> Metadata:
        """The content of ``session.yaml``, read anew unless locked; empty if made by hand.

        Raises
        ------
        ConfigError
            If it is not what comcal wrote.
        """
        if self.is_handmade:
            return {}
        known = self._known or read_metadata(self.session_yaml, FORMAT)
        self._known = known if self._is_locked else None
        return dict(known)

    @property
    def seed(self) -> int | None:
        """Master seed of a simulated recording."""
        seed = self.metadata.get("seed")
        return seed if isinstance(seed, int) else None

    def tares(self) -> dict[str, tuple[Array, Array]]:
        """Return the unloaded readings and their standard errors by sensor, each shape (6,).

        Force, moment [N, N m] in and about the sensor frame, in the sensor's own sense.
        """
        found: dict[str, tuple[Array, Array]] = {}
        for sensor, tare in as_mapping(self.metadata.get("tare")).items():
            entry = as_mapping(tare)
            try:
                value, sigma = (np.array(entry[k], dtype=np.float64) for k in ("value", "sigma"))
            except (KeyError, TypeError, ValueError):
                value = sigma = np.zeros(0)
            if value.shape != (6,) or sigma.shape != (6,):
                raise ConfigError(
                    f"the tare of {sensor} is not {{value: [6 numbers], sigma: [6 numbers]}}",
                    where=str(self.session_yaml),
                    next_step="take the tare again",
                )
            found[str(sensor)] = value, sigma
        return found

    def finished_poses(self) -> tuple[int, ...]:
        """Return the ids of all complete rows of ``poses.csv``, in their order.

        Superseded rows are among them: they are finished too.

        Raises
        ------
        DataError
            If the table is damaged.
        """
        return tuple(int(x) for x in column_numbers(self.poses_csv, ("pose",))[:, 0])

    def measured_positions(self, joint_names: Collection[str]) -> dict[int, Array]:
        """Return the mean joint positions of every finished pose by id, shape (n_joints,)."""
        columns = ("pose", *(f"q.{joint}" for joint in joint_names))
        return {int(row[0]): row[1:] for row in column_numbers(self.poses_csv, columns)}

    def superseded(self) -> tuple[int, ...]:
        """Return the ids of rows that were measured again and are not to be used."""
        repetitions = self.repetitions()
        if not repetitions:
            return ()
        finished = set(self.finished_poses())
        return tuple(old for old, new in repetitions.items() if new in finished)

    def repetitions(self) -> dict[int, int]:
        """Return which pose id measures which older one again: new id by old id."""
        found: dict[int, int] = {}
        for old, new in as_mapping(self.metadata.get("redo")).items():
            if not isinstance(old, int) or not isinstance(new, int):
                raise ConfigError(
                    "redo is not a map of pose ids",
                    where=str(self.session_yaml),
                    next_step="restore session.yaml from a copy",
                )
            found[old] = new
        return found

    @contextmanager
    def lock(self) -> Generator[None, None, None]:
        """Be the only writer while the context lasts; repair what a killed writer left behind.

        Raises
        ------
        UsageError
            If another process is writing into this session.
        """
        if self._is_locked:
            yield
            return
        with locked(self.directory):
            self._is_locked = True
            try:
                repair_tail(self.poses_csv)
                self._note_superseded()
                yield
            finally:
                self._is_locked = False
                self._known = None

    def append_pose(self, row: Mapping[str, object]) -> None:
        """Append one finished pose; when this returns, it is on the disk.

        Parameters
        ----------
        row : mapping from column name to cell
            Numbers, words or None. The first row of a session decides on the columns; later ones
            may leave some out but have no others.

        Raises
        ------
        ConfigError
            If the row has no integer ``pose``, one that exists, or a column that is not there.
        UsageError
            If another process is writing into this session.
        """
        with self.lock():
            if row.get("pose") in self.finished_poses():
                raise ConfigError(
                    f"pose {row['pose']} is finished already",
                    where=str(self.poses_csv),
                    next_step="give it another number, or use --redo",
                )
            append_row(self.poses_csv, row)
            self._note_superseded()

    def plan_repetition(self, pose: int, as_pose: int) -> None:
        """Note that *pose* is going to be measured again as *as_pose*.

        The old row stays in use until the new one is finished, whatever happens in between.
        """
        self.update(redo={**self.repetitions(), pose: as_pose})

    def update(self, **entries: object) -> None:
        """Replace top-level entries of ``session.yaml``."""
        with self.lock():
            write_metadata(self.session_yaml, {**self.metadata, **entries})
            self._known = None

    def _note_superseded(self) -> None:
        """Write down which rows are out of use; late if a kill came in between."""
        superseded = list(self.superseded())
        if superseded != self.metadata.get("superseded", []):
            self.update(superseded=superseded)

    def note_input(self, path: Path) -> bool:
        """Remember the SHA-256 of an input; False when one of that name was another before.

        Parameters
        ----------
        path : Path
        """
        known = as_mapping(self.metadata.get("sha256"))
        digest = sha256_of(path)
        names = [path.name, *(f"{path.name} ({k})" for k in range(2, len(known) + 3))]
        for name in names:
            if known.get(name) == digest:
                break
            if name not in known:
                self.update(sha256={**known, name: digest})
                break
        return known.get(path.name, digest) == digest

    def new_result_folder(self) -> Path:
        """Make the next of ``results/001``, ``results/002``, ... and return it.

        It becomes ``results/latest`` by :meth:`publish_result`, when everything is in it.
        """
        results = self.directory / "results"
        results.mkdir(exist_ok=True)
        number = 1 + max((int(p.name) for p in results.iterdir() if p.name.isdecimal()), default=0)
        while True:
            folder = results / f"{number:03d}"
            try:
                folder.mkdir()
            except FileExistsError:  # another process was faster
                number += 1
                continue
            sync_folder(results)
            return folder

    def publish_result(self, folder: Path) -> None:
        """Let ``results/latest`` point at a result folder whose files are complete."""
        link_atomically(folder.parent / "latest", folder.name)

    def newest_result(self, name: str) -> Path | None:
        """Return the newest published file of one kind, or None.

        Calibrations and diagnoses share the numbers: ``results/latest`` may hold the other kind.

        Parameters
        ----------
        name : str
            Such as ``result.json``.
        """
        latest = self.directory / "results" / "latest"
        if not latest.exists():
            return None
        last = latest.resolve()
        for number in range(int(last.name) if last.name.isdecimal() else 0, 0, -1):
            path = last.with_name(f"{number:03d}") / name
            if path.is_file():
                return path
        return None


@contextmanager
def locked(directory: Path) -> Generator[None, None, None]:
    """Hold the lock of a session folder while the context lasts.

    Raises
    ------
    UsageError
        If another process holds it.
    """
    descriptor = os.open(directory / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as busy:
            raise UsageError(
                "another process is writing into this session",
                where=str(directory),
                next_step="wait until it is done, or give another folder with -s",
            ) from busy
        yield
    finally:
        os.close(descriptor)
