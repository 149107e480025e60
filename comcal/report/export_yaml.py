# SPDX-License-Identifier: Apache-2.0
"""The calibrated links as data and as YAML: ``comcal-model/1``.

Per link: mass, CoM, sigma, frame, and where each number is from.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from comcal.identify.calibrated_model import CalibratedModel, ModelLink

FORMAT = "comcal-model/1"

_HEADER = """\
# Mass and CoM of every link, SI; com and sigma (one standard deviation) in the link's URDF frame.
# provenance of each component of com:
#   measured     determined by itself
#   combination  a term of measured sums (at the end of this file); the sums are measured, how they
#                are shared out is not: by the least change from the URDF
#   prior        the URDF's own number; no pose speaks about it, its sigma is that of `tolerances`
# The CoMs belong to masses multiplied by mass.ratio, measured over URDF of what the sensors carry:
# 1 where both agree. So do the sums. The total CoM is the same with masses multiplied or not.
"""


def model_document(model: CalibratedModel, origin: Mapping[str, Any]) -> dict[str, Any]:
    """Return a calibrated model as JSON-able data, in SI.

    Parameters
    ----------
    model : CalibratedModel
    origin : mapping
        What it was made from: session, result, sha256, versions.
    """
    solution = model.solution
    return {
        "format": FORMAT,
        "robot": model.robot.name,
        **origin,
        "mass": {
            "value": _known(solution.mass),
            "sigma": _known(solution.mass_sigma),
            "urdf": solution.adjustment.unknowns.robot.tree.total_mass,
            "written": model.robot.tree.total_mass,
            "ratio": model.mass_ratio,
        },
        "links": {link.link: _link(link) for link in model.links},
        "combinations": [
            {"words": c.words, "value": c.value, "sigma": c.sigma, "unit": "kg m"}
            for c in model.fitted.combinations
            if len(c.coefficients) > 1
        ],
    }


def _known(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _link(link: ModelLink) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "mass": link.mass,
        "mass_provenance": link.mass_provenance,
        "com": [float(x) for x in link.com],
        "sigma": [float(x) for x in link.sigma],
        "frame": link.link,
        "provenance": list(link.provenance),
        "urdf_com": [float(x) for x in link.urdf_com],
    }
    if np.isfinite(link.mass_sigma):
        entry["mass_sigma"] = link.mass_sigma
    if link.kept:
        entry["kept"] = link.kept
    return entry


def model_yaml(document: Mapping[str, Any]) -> str:
    """Return the text of the YAML file that :func:`model_document` describes.

    Parameters
    ----------
    document : mapping
    """
    yaml = YAML(pure=True)
    yaml.width = 4096
    stream = io.BytesIO()
    yaml.dump(_in_yaml(document), stream)
    return _HEADER + stream.getvalue().decode("utf-8")


def _in_yaml(value: object) -> object:
    """Return *value* with lists of numbers and words on one line, numbers without idle digits."""
    if isinstance(value, Mapping):
        return CommentedMap((key, _in_yaml(item)) for key, item in value.items())
    if isinstance(value, list):
        items = CommentedSeq(_in_yaml(item) for item in value)
        if not any(isinstance(item, Mapping) for item in value):
            items.fa.set_flow_style()
        return items
    if isinstance(value, float):
        return float(np.format_float_positional(value, 9, unique=False, fractional=True))
    return value
