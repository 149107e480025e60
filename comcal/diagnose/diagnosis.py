# SPDX-License-Identifier: Apache-2.0
"""What a diagnosis says: a verdict, causes with their rivals, and what would decide."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

from comcal.effects.registry import stage_of
from comcal.robot.changes import Change
from comcal.robot.tree import Array


class Verdict(Enum):
    """What is said of the model as a whole."""

    NOTHING_WRONG = "nothing_wrong"
    EXPLAINED = "explained"
    AMBIGUOUS = "ambiguous"
    UNEXPLAINED = "unexplained"


@dataclass(frozen=True)
class Estimate:
    """One parameter of a cause: true minus assumed.

    Parameters
    ----------
    value, sigma : float
        In ``unit``; of a stiffness, which is found by its inverse, sigma is to first order.
    interval : tuple of float
        95 %.
    unit : str
    """

    value: float
    sigma: float
    interval: tuple[float, float]
    unit: str


@dataclass(frozen=True)
class Rival:
    """Another cause in the place of one that was named.

    Parameters
    ----------
    effect, target : str
    log_odds : float
        ln evidence of the cause named - ln evidence of this one; 3 is 20 to 1.
    left : float
        Norm of what this one leaves of the cause named, as a share of that cause's own norm: 0
        means that no reading tells them apart, 1 that they have nothing in common.
    left_sigmas : float
        The same in sigmas, as rare as that norm would be if it were noise in all parameters of the
        cause: below 3 noise can hide it, and it is the simpler cause that is preferred, not the
        likelier.
    fits_better : bool
        Whether it holds the cause named as a special case and fits better than chance would let it.
    chi2_more : float
        How much worse it fits than the cause named.
    poses : tuple of int
        Ids of the only poses in which it would act; empty: all.
    """

    effect: str
    target: str
    log_odds: float
    left: float
    left_sigmas: float = float("inf")
    fits_better: bool = False
    chi2_more: float = 0.0
    poses: tuple[int, ...] = ()

    @property
    def name(self) -> str:
        """``effect@target``, and the poses if there are only some."""
        name = f"{self.effect}@{self.target}" if self.target else self.effect
        return f"{name} in pose {', '.join(map(str, self.poses))}" if self.poses else name


@dataclass(frozen=True)
class Gain:
    """How much better poses are predicted that took no part in finding the parameters.

    Parameters
    ----------
    fraction : float
        Share of the whitened squared residuals of held-out poses that the cause removes.
    interval : tuple of float
        95 %: the gain at these poses, were they measured again.
    """

    fraction: float
    interval: tuple[float, float]

    @property
    def is_real(self) -> bool:
        """Whether the interval lies above zero."""
        return self.interval[0] > 0.0


@dataclass(frozen=True)
class HeldOut:
    """One quantity in poses that took no part, with the model as given and as extended.

    Parameters
    ----------
    name, unit : str
        ``foot force``, ``foot moment``, ``CoM`` or ``joint torque``.
    before, after : float
        Root mean square.
    gained : tuple of float
        95 % interval of the mean of before - after over poses; NaN of a single pose.
    """

    name: str
    unit: str
    before: float
    after: float
    gained: tuple[float, float]


@dataclass(frozen=True)
class Cause:
    """One named cause.

    Parameters
    ----------
    change : Change
        Effect, target and parameters: true minus assumed. Applied, it is the extended model.
    estimates : mapping from key to Estimate
    log_odds : float
        ln evidence with it - ln evidence of the same explanation without it; inf of a mistake
        that was undone or of readings that were refused.
    size : float
        Norm of its effect on all residuals, in sigmas of noise and healthy spread together.
    rivals : tuple of Rival
        Strongest first.
    gain : Gain or None
        None: too few poses to hold some out.
    signature, remedy, separated_by : str
        From the catalogue.
    outside : tuple of str
        Keys whose interval does not reach the healthy tolerance.
    """

    change: Change
    estimates: Mapping[str, Estimate]
    log_odds: float
    size: float
    rivals: tuple[Rival, ...] = ()
    gain: Gain | None = None
    signature: str = ""
    remedy: str = ""
    separated_by: str = ""
    outside: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """``effect@target``."""
        return (
            f"{self.change.effect}@{self.change.target}"
            if self.change.target
            else self.change.effect
        )


@dataclass(frozen=True)
class Finding:
    """Readings that were refused, or kept under reserve, before anything was fitted.

    Parameters
    ----------
    effect : str
        ``frozen_sensor``, ``saturation``, ``quantisation`` or ``not_settled``.
    target : str
        Sensor, joint, ``imu`` or empty.
    change : Change
        The same as a change, with its channels, poses, level or step.
    text : str
        What, measured against which limit.
    poses : tuple of int
        Ids; empty: all.
    action : str
        What was done about it: readings left out, noise raised, poses dropped.
    remedy : str
    """

    effect: str
    target: str
    change: Change
    text: str
    poses: tuple[int, ...]
    action: str
    remedy: str


@dataclass(frozen=True)
class Misfit:
    """How well model and readings agree, against noise and healthy spread.

    Parameters
    ----------
    chi2, dof, p : float, int, float
        After the causes named; ``p`` is the chance of a larger chi2 if nothing else is wrong.
    chi2_before, p_before : float
        Of the model as it was given.
    held_out_before, held_out_after : float or None
        Whitened mean square of held-out poses, without and with the causes; 1 is noise.
    p_row, row : float, str
        The chance that any row by itself is as far off as the worst one, and which that is: one
        row that is wrong drowns among hundreds.
    """

    chi2: float
    dof: int
    p: float
    chi2_before: float
    p_before: float
    held_out_before: float | None = None
    held_out_after: float | None = None
    p_row: float = 1.0
    row: str = ""

    @property
    def chance(self) -> float:
        """How likely it is that all rows together, or one by itself, are so far off by chance."""
        return min(1.0, 2.0 * min(self.p, self.p_row))


@dataclass(frozen=True)
class Channel:
    """One kind of residual row over all poses.

    Parameters
    ----------
    name, unit : str
        Such as ``equilibrium My``, ``torque l_knee``.
    before, after : float
        Root mean square in ``unit``, with the model as given and as extended.
    sigmas_before, sigmas_after : float
        The same against noise and healthy spread; 1 is what a healthy robot shows.
    follows : str
        What the residual goes along with (a joint, load, time, temperature, approach), in words;
        empty when nothing stands out.
    worst : int
        Id of the pose with the largest residual.
    """

    name: str
    unit: str
    before: float
    after: float
    sigmas_before: float
    sigmas_after: float
    follows: str = ""
    worst: int = -1


@dataclass(frozen=True)
class Place:
    """Where something acts that the catalogue has no name for.

    Parameters
    ----------
    place : str
        ``encoder``, ``current``, ``sensor``, ``link moment`` or ``floor``.
    target : str
        Joint, sensor or link; empty for the floor.
    function : str
        What it is a function of, as far as the poses tell, in words.
    log_odds : float
        Against no such place.
    """

    place: str
    target: str
    function: str
    log_odds: float


@dataclass(frozen=True)
class Trace:
    """Residuals of one row over the poses, for plots.

    Parameters
    ----------
    name, unit : str
    poses : tuple of int
        Ids.
    before, after : array, shape (len(poses),)
        In ``unit``; NaN where a reading is missing.
    sigma : array, shape (len(poses),)
        Of noise and healthy spread together.
    """

    name: str
    unit: str
    poses: tuple[int, ...]
    before: Array
    after: Array
    sigma: Array


@dataclass(frozen=True)
class Rung:
    """One step of the search: the causes that were best at that step.

    Parameters
    ----------
    named : tuple of str
        Causes already accepted.
    best : tuple of (str, float)
        The strongest further causes with the log odds that each would add.
    threshold : float
        Log odds that a cause must reach.
    chi2 : float
        Left at this step.
    """

    named: tuple[str, ...]
    best: tuple[tuple[str, float], ...]
    threshold: float
    chi2: float


@dataclass(frozen=True)
class Diagnosis:
    """What a model gets wrong.

    Parameters
    ----------
    verdict : Verdict
    sentence : str
        The first sentence, in plain words.
    causes : tuple of Cause
        Largest first. With the verdict ``unexplained`` they are partial and not to be trusted.
    groups : tuple of tuple of Rival
        Sets of causes that the readings do not tell apart, each with the one named first
        (log odds 0), then the likeliest of every other kind, then other places.
    findings : tuple of Finding
    place : Place or None
        For ``unexplained``.
    misfit : Misfit
    would_decide : tuple of str
        Pose types or channels that would separate what is ambiguous, and advice.
    channels : tuple of Channel
        Largest ``sigmas_before`` first.
    traces : tuple of Trace
    ladder : tuple of Rung
    scales : mapping from family to float
        Factors by which healthy tolerances (``noise``: the stated noise) seem to be wrong; only
        those that differ from 1.
    blind : tuple of str
        Causes of the catalogue that these poses and channels could not show at the size of a
        fault.
    notes : tuple of str
        What is missing (no IMU, no currents, ...) and can therefore not be told apart.
    poses, used_rows : int
    held_out : tuple of HeldOut
        What the extended model gains in units; empty: too few poses.
    signatures : mapping from cause to mapping from row to float
        Where causes named and their rivals show: ``effect@target`` to the share of the squared
        norm of its effect in each row, or kind of row.
    """

    verdict: Verdict
    sentence: str
    causes: tuple[Cause, ...]
    groups: tuple[tuple[Rival, ...], ...]
    findings: tuple[Finding, ...]
    place: Place | None
    misfit: Misfit
    would_decide: tuple[str, ...]
    channels: tuple[Channel, ...]
    traces: tuple[Trace, ...] = ()
    ladder: tuple[Rung, ...] = ()
    scales: Mapping[str, float] = field(default_factory=dict[str, float])
    blind: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    poses: int = 0
    used_rows: int = 0
    held_out: tuple[HeldOut, ...] = ()
    signatures: Mapping[str, Mapping[str, float]] = field(
        default_factory=dict[str, Mapping[str, float]]
    )

    @property
    def changes(self) -> tuple[Change, ...]:
        """Every cause as a change of the model that was given, in the order of correction."""
        return tuple(sorted((cause.change for cause in self.causes), key=stage_of))
