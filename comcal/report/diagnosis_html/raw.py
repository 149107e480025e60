# SPDX-License-Identifier: Apache-2.0
"""The readings themselves, pose by pose, beside the residuals."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from comcal.measure.table import PoseTable
from comcal.report.diagnosis_html.markup import Markup, element, joined
from comcal.report.diagnosis_html.svg import HEIGHT, WIDTH, axes, figure, framed
from comcal.robot.changes_table import CHANNELS
from comcal.robot.tree import Array


@dataclass(frozen=True)
class RawChannel:
    """Readings of one channel of a force sensor over the poses.

    Parameters
    ----------
    name, unit : str
    poses : tuple of int
        Ids.
    values : array, shape (len(poses),)
        As the pose table has them: tare subtracted, on the robot, in the sensor frame.
    """

    name: str
    unit: str
    poses: tuple[int, ...]
    values: Array


def raw_channels(table: PoseTable) -> tuple[RawChannel, ...]:
    """Return the readings of all force sensors; channels without any are left out.

    Parameters
    ----------
    table : PoseTable
    """
    return tuple(
        RawChannel(f"{sensor} {axis}", "N" if k < 3 else "N m", table.pose, wrench[:, k])
        for sensor, wrench in table.wrench.items()
        for k, axis in enumerate(CHANNELS)
        if np.isfinite(wrench[:, k]).any()
    )


def raw_section(channels: Sequence[RawChannel], doubtful: Collection[int] = ()) -> Markup:
    """Return charts of readings, folded; empty without any.

    Parameters
    ----------
    channels : sequence of RawChannel
    doubtful : collection of int
        Poses with readings that were refused.
    """
    if not channels:
        return joined()
    note = (
        "As measured, tares subtracted. In double support statics does not determine how the feet "
        "share the load: only the residuals above can be held against a model."
    )
    return element(
        "section",
        element("h2", "Readings of the force sensors"),
        element("p", note),
        element(
            "details",
            element("summary", f"{len(channels)} channels"),
            element("div", *(_chart(c, doubtful) for c in channels), class_="grid"),
        ),
    )


def _chart(channel: RawChannel, doubtful: Collection[int]) -> Markup:
    frame = framed(channel.values, len(channel.poses), zero=False)
    name = f"{channel.name} [{channel.unit}]"
    marks: list[Markup] = []
    for i, (pose, value) in enumerate(zip(channel.poses, channel.values, strict=True)):
        if not np.isfinite(value):
            continue
        refused = pose in doubtful
        words = f"pose {pose}: {value:.4g} {channel.unit}{', under reserve' if refused else ''}"
        kind = "refused" if refused else "raw"
        dot = element("circle", cx=frame.x(i), cy=frame.y(float(value)), r=2.2, class_=kind)
        marks.append(element("g", element("title", words), dot))
    chart = figure(name, WIDTH, HEIGHT, *axes(frame, channel.poses), *marks)
    return element("figure", element("figcaption", name), chart)
