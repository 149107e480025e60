# SPDX-License-Identifier: Apache-2.0
"""Every error that comcal raises on purpose.

::

    ComcalError
    ├── UsageError              2   what was typed or configured cannot work
    │   ├── ConfigError             robot.yaml, plan.csv, MAP.yaml, study file (also ValueError)
    │   ├── UrdfError               the URDF is missing, not XML, or not a tree (also ValueError)
    │   └── MissingColumnError      a joint or sensor column is absent (also KeyError)
    ├── DataError               3   the data cannot carry the answer (also ValueError)
    │   ├── NotFiniteError          NaN, infinite or empty cells
    │   ├── NotStillError           the robot moved during the window
    │   ├── NotReachedError         the robot never came to a pose, or left it too early
    │   ├── UnitsError              numbers that look like degrees, millimetres, grams
    │   ├── SignError               a wrench of the wrong sign, or sensors exchanged
    │   ├── NotBalancedError        the wrench is not that of a body at rest
    │   ├── NotARigidTiltError      two poses are not one body tilted about the ankles
    │   └── RankError               the poses do not determine what was asked
    ├── HardwareError           4   a device does not answer (also OSError)
    └── MissingExtraError       6   an optional package is not installed (also ImportError)

Exit code 5 (a limit is not met) is a verdict, not an error; exit code 1 is a bug of ours.
"""

from __future__ import annotations

from typing import ClassVar


class ComcalError(Exception):
    """Root of all errors raised on purpose.

    Parameters
    ----------
    what : str
        What is wrong, in one sentence without a full stop.
    where : str
        ``file:line``, pose, sensor or joint at which it was seen.
    measured, limit : str
        The number found, with its unit, and the number it had to respect.
    next_step : str
        What the reader should do about it.
    """

    exit_code: ClassVar[int] = 1

    def __init__(
        self,
        what: str,
        *,
        where: str = "",
        measured: str = "",
        limit: str = "",
        next_step: str = "",
    ) -> None:
        self.what = what
        self.where = where
        self.measured = measured
        self.limit = limit
        self.next_step = next_step
        super().__init__(self.message())

    def message(self) -> str:
        """Return the error as one line: where, what, measured against limit, what to do next."""
        text = f"{self.where}: {self.what}" if self.where else self.what
        if self.measured and self.limit:
            text += f" ({self.measured}, limit {self.limit})"
        elif self.measured or self.limit:
            text += f" ({self.measured or 'limit ' + self.limit})"
        if self.next_step:
            text += f"; {self.next_step}"
        return text

    def __str__(self) -> str:
        return self.message()


class UsageError(ComcalError):
    """What was typed or configured cannot work."""

    exit_code: ClassVar[int] = 2


class ConfigError(UsageError, ValueError):
    """A file that the user wrote (robot.yaml, plan.csv, map, study) is not valid."""


class UrdfError(UsageError, ValueError):
    """The URDF is missing, is not XML, or does not describe a tree."""


class MissingColumnError(UsageError, KeyError):
    """A table lacks the column of a joint or of a sensor."""


class DataError(ComcalError, ValueError):
    """The data cannot carry the answer that was asked of them."""

    exit_code: ClassVar[int] = 3


class NotFiniteError(DataError):
    """A cell is empty, NaN or infinite where a number is needed."""


class NotStillError(DataError):
    """The robot moved during the measuring window."""


class NotReachedError(DataError):
    """The robot never came to a pose, or left it before it could be measured."""


class UnitsError(DataError):
    """Numbers look like degrees, millimetres or another unit than SI."""


class SignError(DataError):
    """A wrench has the wrong sign, or left and right are exchanged."""


class NotBalancedError(DataError):
    """A wrench is not that of a body at rest under gravity."""


class NotARigidTiltError(DataError):
    """Two poses are not one rigid body turned about the ankle axis."""


class RankError(DataError):
    """The poses do not determine what was asked."""


class HardwareError(ComcalError, OSError):
    """A device does not answer, or answers wrongly."""

    exit_code: ClassVar[int] = 4


class MissingExtraError(ComcalError, ImportError):
    """An optional package is not installed."""

    exit_code: ClassVar[int] = 6
