# SPDX-License-Identifier: Apache-2.0
"""Diagnoses made by hand, one for each verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from comcal.diagnose.diagnosis import (
    Cause,
    Channel,
    Diagnosis,
    Estimate,
    Finding,
    Gain,
    HeldOut,
    Misfit,
    Place,
    Rival,
    Rung,
    Trace,
    Verdict,
)
from comcal.robot.changes import Change

POSES = tuple(range(1, 25))


def estimate(value: float, sigma: float, unit: str) -> Estimate:
    return Estimate(value, sigma, (value - 1.96 * sigma, value + 1.96 * sigma), unit)


def payload() -> Cause:
    found = {
        "mass": estimate(5.02, 0.055, "kg"),
        "com_x": estimate(0.1013, 0.0041, "m"),
        "com_y": estimate(-0.0021, 0.0038, "m"),
        "com_z": estimate(0.198, 0.0093, "m"),
    }
    return Cause(
        Change("payload", "torso", {key: e.value for key, e in found.items()}),
        found,
        log_odds=812.4,
        size=41.3,
        rivals=(
            Rival("link_mass", "torso", math.log(400.0), 0.21),
            Rival("link_com", "torso", 31.0, 0.48),
            Rival("cable_pull", "torso", 55.0, 0.6),
            Rival("ft_gain", "l_foot", 102.0, 0.9),
        ),
        gain=Gain(0.41, (0.33, 0.48)),
        signature="vertical force constant, moments with the link's place",
        remedy="weigh what was added, and give it to the URDF",
        separated_by="joints next to the link moved",
        outside=("mass", "com_x", "com_z"),
    )


def traces() -> tuple[Trace, ...]:
    rng = np.random.default_rng(5)
    x = np.linspace(0.0, 6.0, len(POSES))
    made = []
    for name, unit, size in (
        ("equilibrium Fz", "N", 49.0),
        ("equilibrium My", "N m", 8.0),
        ("torque waist_pitch", "N m", 3.0),
        ("closure pitch", "rad", 0.0),
    ):
        sigma = np.full(len(POSES), 0.4 if unit != "rad" else 4e-4)
        noise = sigma * rng.standard_normal(len(POSES))
        shape = 1.0 if name.endswith("Fz") else np.sin(x)
        before = size * shape + noise
        if unit == "N m":
            before = np.where(np.arange(len(POSES)) == 3, np.nan, before)
        made.append(Trace(name, unit, POSES, before, noise, sigma))
    return tuple(made)


def explained() -> Diagnosis:
    return Diagnosis(
        verdict=Verdict.EXPLAINED,
        sentence="The model lacks a body of 5.0 kg at torso.",
        causes=(payload(),),
        groups=(),
        findings=(),
        place=None,
        misfit=Misfit(214.2, 205, 0.315, 2012.7, 0.0, 3.42, 1.02),
        would_decide=(),
        channels=(
            Channel("equilibrium Fz", "N", 49.3, 0.41, 38.2, 0.98, "nothing: the same always", 7),
            Channel("equilibrium My", "N m", 8.1, 0.22, 21.7, 1.04, "waist_pitch", 3),
            Channel("torque waist_pitch", "N m", 3.1, 0.3, 7.9, 1.1, "waist_pitch", 3),
            Channel("closure pitch", "rad", 0.0004, 0.0004, 1.0, 1.0),
        ),
        traces=traces(),
        ladder=(
            Rung((), (("payload@torso", 812.4), ("link_mass@torso", 806.0)), 8.1, 2012.7),
            Rung(("payload@torso",), (("ft_bias@l_foot", 2.2), ("ft_gain@r_foot", -1)), 8.1, 214.2),
        ),
        scales={"link_com": 2.0, "noise": 1.25},
        blind=(*(f"joint_offset@arm_{k}" for k in range(7)), "imu_mounting"),
        notes=("no IMU: imu_mounting cannot be seen",),
        poses=len(POSES),
        used_rows=209,
        held_out=(
            HeldOut("CoM", "mm", 11.2, 0.53, (9.1, 12.2)),
            HeldOut("joint torque", "N m", 1.31, 1.3, (math.nan, math.nan)),
        ),
        signatures={
            "payload@torso": {"equilibrium": 0.81, "torque": 0.55, "closure": 0.0},
            "link_mass@torso": {"equilibrium": 0.85, "torque": 0.5, "closure": 0.0},
        },
    )


def ambiguous() -> Diagnosis:
    found = {"fx": estimate(0.002, 0.0004, "N/s"), "fz": estimate(0.003, 0.0005, "N/s")}
    drift = Cause(
        Change("ft_drift", "l_foot", {key: e.value for key, e in found.items()}),
        found,
        log_odds=21.0,
        size=9.4,
        rivals=(Rival("ft_temperature", "l_foot", 0.6, 0.001),),
        gain=Gain(0.04, (-0.01, 0.09)),
    )
    return replace(
        explained(),
        verdict=Verdict.AMBIGUOUS,
        sentence="Readings of l_foot wander: by time or by temperature, which is not known.",
        causes=(drift,),
        groups=(
            (Rival("ft_drift", "l_foot", 0.0, 0.0), Rival("ft_temperature", "l_foot", 0.6, 0.001)),
        ),
        would_decide=("revisit poses at another temperature",),
        misfit=Misfit(214.2, 205, 0.315, 260.0, 0.005, 1.31, 1.25),
        signatures={},
    )


def unexplained() -> Diagnosis:
    frozen = Change("saturation", "r_foot", {"channels": ("fz",), "level": 600.0})
    return replace(
        explained(),
        verdict=Verdict.UNEXPLAINED,
        sentence="Something at the encoder of l_knee that the catalogue has no name for.",
        place=Place("encoder", "l_knee", "sin(q)", 37.0),
        misfit=Misfit(514.2, 205, 2e-29, 2012.7, 0.0, 3.42, 2.2),
        findings=(
            Finding(
                "saturation",
                "r_foot",
                frozen,
                "fz stands at 600 N in 3 poses, limit 1",
                (4, 9, 11),
                "readings left out",
                "use a sensor of a larger range & check <its> amplifier",
            ),
        ),
    )


def healthy() -> Diagnosis:
    return replace(
        explained(),
        verdict=Verdict.NOTHING_WRONG,
        sentence="Readings and model agree within noise and healthy tolerances.",
        causes=(),
        misfit=Misfit(201.0, 209, 0.64, 201.0, 0.64, 1.01, 1.01),
        channels=(),
        traces=(),
        ladder=(),
        signatures={},
        scales={},
        notes=(),
        blind=(),
    )


@pytest.fixture
def diagnoses() -> Mapping[str, Diagnosis]:
    """By verdict."""
    made = (explained(), ambiguous(), unexplained(), healthy())
    return {diagnosis.verdict.value: diagnosis for diagnosis in made}
