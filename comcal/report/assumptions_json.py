# SPDX-License-Identifier: Apache-2.0
"""What was assumed beside the data, for ``result.json``: ``with_prior`` and ``consistent``.

Sections of their own: ``links`` of the result holds measured numbers only, whatever was asked for.
"""

from __future__ import annotations

from typing import Any

from comcal.identify.consistent import ConsistentFit
from comcal.identify.prior import PriorFit
from comcal.report.json_numbers import number, numbers


def prior_json(prior: PriorFit) -> dict[str, Any]:
    """Return data and prior together; ``prior_share`` is 1 where nothing was measured.

    Parameters
    ----------
    prior : PriorFit
    """
    unknowns = prior.fit.unknowns
    return {
        "strength": prior.strength,
        "chi2": prior.chi2,
        "dof": prior.dof,
        "p": number(prior.p),
        "contradict": prior.contradict,
        "agreeing_strength": prior.agreeing_strength,
        "far": [{"unknown": name, "sigmas": sigmas} for name, sigmas in prior.far],
        "unknowns": [
            {"name": name, "value": float(value), "sigma": float(sigma), "prior_share": float(s)}
            for name, value, sigma, s in zip(
                unknowns.names, prior.theta, prior.sigma, prior.share, strict=True
            )
        ],
        "links": [
            {
                "link": link.link,
                "mass": link.mass,
                "mass_sigma": number(link.mass_sigma),
                "mass_prior_share": link.mass_share,
                "mass_source": link.mass_source,
                "com": numbers(link.com),
                "sigma": numbers(link.sigma),
                "prior_share": numbers(link.share),
                "source": list(link.source),
            }
            for link in prior.links
        ],
    }


def consistent_json(consistent: ConsistentFit) -> dict[str, Any]:
    """Return the nearest physically possible robot, or the bounds that contradict one another.

    Parameters
    ----------
    consistent : ConsistentFit
    """
    return {
        "feasible": consistent.theta is not None,
        "active": [{"bound": a.bound.words, "pull": a.pull} for a in consistent.active],
        "contradiction": [bound.words for bound in consistent.contradiction],
        "chi2_increase": number(consistent.chi2_increase),
        "dof": consistent.dof,
        "p": number(consistent.p),
        "contradicted": consistent.contradicted,
        "without_bounds": [{"link": link, "why": why} for link, why in consistent.without],
        "links": [
            {
                "link": link.link,
                "mass": link.mass,
                "mass_source": link.mass_source,
                "com": numbers(link.com),
                "without_bounds": numbers(link.before),
                "source": list(link.source),
            }
            for link in consistent.links
        ],
    }
