# SPDX-License-Identifier: Apache-2.0
"""Fits made by hand: any subspace seen, any values, no poses behind them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from comcal.identify.adjust import Adjustment
from comcal.identify.unknowns import Unknowns, unknowns_of
from comcal.robot.model import Robot
from comcal.robot.tree import Box, Joint, JointType, Link, Tree

FitMaker = Callable[..., Adjustment]
RobotMaker = Callable[..., Robot]


def make_robot(
    boxes: Sequence[Sequence[Box]] = ((), ()),
    masses: Sequence[float] = (4.0, 2.0),
    kind: JointType = JointType.REVOLUTE,
    **fields: object,
) -> Robot:
    """A chain of links, a quarter of a metre from joint to joint, CoMs off all axes."""
    links = tuple(
        Link(f"link{k}", mass, np.array([0.02, -0.01, 0.1 + 0.02 * k]), np.eye(3), boxes=tuple(b))
        for k, (mass, b) in enumerate(zip(masses, boxes, strict=True))
    )
    T = np.eye(4)
    T[2, 3] = 0.25
    axis = np.array([0.0, 1.0, 0.0]) * (kind is not JointType.FIXED)
    joints = tuple(
        Joint(f"joint{k}", kind, f"link{k - 1}", f"link{k}", T, axis) for k in range(1, len(links))
    )
    return Robot("chain", Tree("chain", links, joints), **fields)


def make_fit(
    unknowns: Unknowns, theta: np.ndarray, directions: np.ndarray, singular: np.ndarray
) -> Adjustment:
    """A fit that sees the span of *directions* (columns, scaled unknowns), so well."""
    size = unknowns.size
    whole, _ = np.linalg.qr(np.concatenate([directions, np.eye(size)], axis=1))
    rank = directions.shape[1]
    seen, unseen = whole[:, :rank], whole[:, rank:size]
    along = unknowns.scale[:, None] * seen
    change = seen @ seen.T @ ((theta - unknowns.cad) / unknowns.scale)
    return Adjustment(
        unknowns=unknowns,
        groups=(),
        theta=unknowns.cad + unknowns.scale * change,
        seen=seen,
        unseen=unseen,
        singular=singular,
        cov=(along / singular**2) @ along.T,
        cov_cad=np.zeros((size, size)),
        sensitivity=(),
        residuals=(),
        chi2=0.0,
        dof=0,
        iterations=1,
    )


@pytest.fixture(scope="session")
def chain() -> RobotMaker:
    """A chain of links, by boxes, masses and kind of joint."""
    return make_robot


@pytest.fixture(scope="session")
def fit_of() -> FitMaker:
    """A fit by its unknowns, values, seen directions and singular values."""
    return make_fit


@pytest.fixture(scope="session")
def random_fit() -> FitMaker:
    """Some fit of the chain of two links; what it sees, and how well, is drawn."""

    def draw(seed: int, rank: int | None = None, *, free_masses: bool, robot: Robot | None = None):
        rng = np.random.default_rng(seed)
        unknowns = unknowns_of(robot or make_robot(), free_masses=free_masses)
        rank = rank or int(rng.integers(1, unknowns.size + 1))
        directions = rng.standard_normal((unknowns.size, rank))
        singular = np.sort(np.exp(rng.uniform(np.log(10.0), np.log(2000.0), rank)))[::-1]
        theta = unknowns.cad + 0.02 * unknowns.scale * rng.standard_normal(unknowns.size)
        return make_fit(unknowns, theta, directions, singular)

    return draw
