# SPDX-License-Identifier: Apache-2.0
"""One calibration of a study: a robot is built, measured and calibrated, and found out.

Everything random comes from (master seed, robot, noise, index), so it does not matter which
process does it, or when.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from zlib import crc32

import numpy as np

from comcal.errors import ComcalError
from comcal.identify.adjust import adjust
from comcal.identify.groups import groups_of
from comcal.identify.quantities import estimates, true_values
from comcal.identify.unknowns import unknowns_of
from comcal.measure.source import Block, SourceRequest
from comcal.measure.tabulate import tabulate
from comcal.robot.draw import draw_robot
from comcal.workflow.sources import open_source
from comcal.workflow.study_file import NoiseSection
from comcal.workflow.study_robot import WORLD, StudyRobot, still_window, told_noise


@dataclass(frozen=True, order=True)
class TrialKey:
    """Which calibration: the names of robot and noise, master seed, number from 0."""

    robot: str
    noise: str
    master: int
    index: int


@dataclass(frozen=True)
class Trial:
    """What became of one calibration.

    Parameters
    ----------
    error, sigma : tuple of float
        In the order of the robot's quantities [kg], [m]; empty where it failed.
    withheld : tuple of int
        Positions of quantities that this calibration would not have reported.
    rank, dof, iterations : int
        Of the fit.
    chi2 : float
        Weighted sum of its squared residuals.
    failed : str
        Why there is no result; usually empty.
    """

    key: TrialKey
    error: tuple[float, ...] = ()
    sigma: tuple[float, ...] = ()
    withheld: tuple[int, ...] = ()
    rank: int = 0
    chi2: float = 0.0
    dof: int = 0
    iterations: int = 0
    failed: str = ""


def run_trials(
    subject: StudyRobot, noise: NoiseSection, keys: Sequence[TrialKey]
) -> tuple[Trial, ...]:
    """Run some calibrations of one robot with one noise.

    Parameters
    ----------
    subject : StudyRobot
    noise : NoiseSection
    keys : sequence of TrialKey
    """
    return tuple(run_trial(subject, noise, key) for key in keys)


def run_trial(subject: StudyRobot, noise: NoiseSection, key: TrialKey) -> Trial:
    """Draw a true robot, measure it, calibrate the nominal one, and compare.

    Parameters
    ----------
    subject : StudyRobot
    noise : NoiseSection
    key : TrialKey

    Returns
    -------
    Trial
        A calibration that is refused is an outcome too: it has ``failed``.
    """
    entropy = [key.master, crc32(key.robot.encode()), crc32(key.noise.encode()), key.index]
    for_robot, for_sensors = np.random.SeedSequence(entropy).spawn(2)
    told = told_noise(subject.robot, noise)
    true = draw_robot(told, np.random.default_rng(for_robot))
    seed = int.from_bytes(for_sensors.generate_state(2, np.uint32).tobytes(), "little")
    sizes = {name: getattr(noise, name) for name in ("ft_force", "ft_moment", "encoder")}
    try:
        windows: list[Block] = []
        with open_source(WORLD, SourceRequest(robot=true, seed=seed, options=sizes)) as source:
            for pose in subject.poses:
                source.move_to(pose)
                windows.append(still_window(source, noise.samples))
        table = tabulate(told, subject.poses, windows, WORLD)
        fit = adjust(told, unknowns_of(told), groups_of(told, table))
    except ComcalError as refusal:
        return Trial(key, failed=str(refusal))
    found = estimates(fit, subject.quantities)
    error = found.value - true_values(true, subject.quantities)
    return Trial(
        key,
        error=tuple(error.tolist()),
        sigma=tuple(found.sigma.tolist()),
        withheld=tuple(np.flatnonzero(~found.reported).tolist()),
        rank=fit.rank,
        chi2=fit.chi2,
        dof=fit.dof,
        iterations=fit.iterations,
    )
