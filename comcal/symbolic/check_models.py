# SPDX-License-Identifier: Apache-2.0
"""The robots that random points are drawn for, and their moment balance in complex numbers.

In the x-z plane of P a vector is z + j x with j^2 = -1, and a turn by phi to the toes is a product
with e^(j phi). Nothing here is taken from a printed formula.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from comcal.robot.tree import Array
from comcal.statics.planar import ComplexArray
from comcal.symbolic.check_points import Draw, Kind


def first_moment(
    masses: list[Array],
    vectors: list[ComplexArray],
    lengths: list[Array],
    pitch: list[Array],
    U: Array,
) -> ComplexArray:
    """Return the first moment z + j x about P of a planar chain, shape (count,) [kg m].

    Parameters
    ----------
    masses : list of array, shape (count,)
        [kg].
    vectors : list of complex array, shape (count,)
        CoM of each link from its lower joint when it is upright, l + j r [m].
    lengths : list of array, shape (count,)
        Of each link, to the next joint [m].
    pitch : list of array, shape (count,)
        Absolute, positive to the toes [rad].
    U : array, shape (count,)
        Height of the lowest joint in P [m].
    """
    joint = U.astype(np.complex128)
    total = np.zeros_like(joint)
    for m, w, L, phi in zip(masses, vectors, lengths, pitch, strict=True):
        turn = np.exp(1j * phi)
        total = total + m * (joint + w * turn)
        joint = joint + L * turn
    return total


def chain_points(draw: Draw, n: int) -> None:
    """Draw a planar chain of n links above the ankles, its pitches theta_v and joints q_v."""
    links = range(1, n + 1)
    draw.masses([f"m_{v}" for v in links])
    draw.feet()
    draw.draw_signed(Kind.LENGTH, 0.02, 0.1, *(f"r_{v}" for v in links))
    draw.draw(Kind.LENGTH, 0.1, 0.6, *(f"l_{v}" for v in links), *(f"L_{v}" for v in links))
    draw.draw_signed(Kind.ANGLE, 0.2, 1.3, *(f"theta_{v}" for v in links))
    angles = {f"theta_{v}": draw.values[f"theta_{v}"] for v in links}
    draw.put(Kind.ANGLE, **draw.posture(angles))
    draw.drawn.update(angles)
    v = draw.values
    pitch = [v[f"theta_{k}"] for k in links]
    before = [np.zeros(draw.count), *pitch]
    draw.put(Kind.ANGLE, **{f"q_{k}": p - b for k, p, b in zip(links, pitch, before, strict=False)})
    moment = first_moment(
        [v[f"m_{k}"] for k in links],
        [v[f"l_{k}"] + 1j * v[f"r_{k}"] for k in links],
        [v[f"L_{k}"] for k in links],
        pitch,
        v["U"],
    )
    draw.totals("", moment)


def paper_points(draw: Draw, _n: int) -> None:
    """Draw the three links of Figure 4 in the poses b and c."""
    draw.masses(["m_b", "m_c"])
    draw.feet()
    draw.draw_signed(Kind.LENGTH, 0.02, 0.1, "r_b", "r_c")
    draw.draw(Kind.LENGTH, 0.1, 0.6, "l_b", "l_c", "L_b", "L_c")
    draw.draw_signed(Kind.ANGLE, 0.2, 1.3, "theta_b", "theta_c")
    draw.alias(m_a="m_u", r_a="r_u", l_a="l_u", L_a="U")
    v = draw.values
    u = [v["r_b"], v["l_b"], v["r_c"], v["l_c"]]
    draw.totals("b", paper_moments(v, u)[0])
    draw.totals("c", paper_moments(v, u)[1])


def cramer_points(draw: Draw, n: int) -> None:
    """Draw as :func:`paper_points` and put the right-hand side a and det_A of (38), (39)."""
    paper_points(draw, n)
    v = draw.values
    u = [v[name] for name in ("r_b", "l_b", "r_c", "l_c")]
    A = paper_matrix(v)
    draw.put(Kind.FIRST_MOMENT, **{f"a_{i + 1}": a for i, a in enumerate(_times(A, u))})
    draw.put(Kind.DETERMINANT, det_A=determinant(A))


def paper_moments(v: Mapping[str, Array], u: list[Array]) -> tuple[ComplexArray, ComplexArray]:
    """Return the first moments z + j x of poses b and c for the unknowns u [kg m].

    Parameters
    ----------
    v : mapping of str to array, shape (count,)
        What is known.
    u : list of array, shape (count,)
        r_b, l_b, r_c, l_c [m].
    """
    masses, lengths = [v["m_b"], v["m_c"]], [v["L_b"], v["L_c"]]
    vectors = [u[1] + 1j * u[0], u[3] + 1j * u[2]]
    b = first_moment(masses, vectors, lengths, [v["theta_b"], v["theta_b"]], v["U"])
    c = first_moment(masses, vectors, lengths, [0.0 * v["theta_c"], v["theta_c"]], v["U"])
    return b, c


def paper_matrix(v: Mapping[str, Array]) -> Array:
    """Return what multiplies r_b, l_b, r_c, l_c in the balance of b and c, shape (4, 4, count).

    Parameters
    ----------
    v : mapping of str to array, shape (count,)

    Notes
    -----
    Rows as in (38): x and z of b, x and z of c. The balance is linear in the unknowns: without the
    lengths, a column is what one unknown of 1 m gives.
    """
    zero = np.zeros_like(v["m_b"])
    short = {**v, "U": zero, "L_b": zero, "L_c": zero}
    columns: list[Array] = []
    for k in range(4):
        b, c = paper_moments(short, [zero + float(i == k) for i in range(4)])
        columns.append(np.stack([b.imag, b.real, c.imag, c.real]))
    return np.stack(columns, axis=1)


def determinant(A: Array) -> Array:
    """Return the determinants of matrices of shape (k, k, count), shape (count,).

    Parameters
    ----------
    A : array, shape (k, k, count)
    """
    return np.linalg.det(np.moveaxis(A, -1, 0))


def _times(A: Array, u: list[Array]) -> Array:
    return np.einsum("rkp,kp->rp", A, np.array(u))


def two_feet_points(draw: Draw, _n: int) -> None:
    """Draw wrenches of two feet at y = -l (0) and y = l (1) that balance one weight: (1)-(15)."""
    draw.draw(Kind.FORCE, 50.0, 300.0, "F_Z0", "F_Z1")
    draw.draw_signed(Kind.FORCE, 5.0, 50.0, "F_X0", "F_X1", "F_Y0", "F_Y1")
    moments = [f"M_{axis}{i}" for axis in "XYZ" for i in range(3)]
    draw.draw_signed(Kind.MOMENT, 5.0, 30.0, *moments)
    draw.draw(Kind.LENGTH, 0.05, 0.2, "l")
    draw.draw(Kind.LENGTH, 0.3, 0.9, "Z_2")
    v = draw.values
    force = np.array([v[f"F_{axis}0"] + v[f"F_{axis}1"] for axis in "XYZ"])
    arms = (np.array([0 * v["l"], -v["l"], 0 * v["l"]]), np.array([0 * v["l"], v["l"], 0 * v["l"]]))
    moment = np.zeros((3, draw.count))
    for i, arm in enumerate(arms):
        F = np.array([v[f"F_{axis}{i}"] for axis in "XYZ"])
        moment += np.array([v[f"M_{axis}{i}"] for axis in "XYZ"]) + np.cross(arm, F, axis=0)
    # The weight passes through the CoM: moment = CoM x force. At the height 0 this gives the foot
    # of its line, and the force its direction.
    alpha, gamma = -moment[1] / force[2], moment[0] / force[2]
    beta, delta = force[0] / force[2], force[1] / force[2]
    X, Y = alpha + beta * v["Z_2"], gamma + delta * v["Z_2"]
    draw.put(Kind.LENGTH, alpha=alpha, gamma=gamma, X_2=X, Y_2=Y)
    draw.put(Kind.SLOPE, beta=beta, delta=delta)


def two_pose_points(draw: Draw, _n: int) -> None:
    """Draw a pose A and the same shape tilted by theta_t about the ankles, B: (14)-(20)."""
    draw.draw(Kind.MASS, 0.5, 5.0, "m_w", "m_u", "m_2")
    if draw.linked:
        draw.put(Kind.MASS, m_2=draw.values["m_w"] + draw.values["m_u"])
    draw.feet()
    draw.draw_signed(Kind.LENGTH, 0.02, 0.1, "r_w")
    draw.draw(Kind.LENGTH, 0.1, 0.6, "l_w")
    draw.draw_signed(Kind.ANGLE, 0.2, 1.3, "theta_t")
    draw.draw_signed(Kind.SLOPE, 0.05, 0.3, "beta_A", "beta_B")
    v = draw.values
    w = v["l_w"] + 1j * v["r_w"]
    for pose, tilt in (("A", 0.0 * v["theta_t"]), ("B", v["theta_t"])):
        moment = first_moment([v["m_w"]], [w], [v["l_w"]], [tilt], v["U"])
        X = (v["m_u"] * v["r_u"] + moment.imag) / v["m_2"]
        Z = (v["m_u"] * v["l_u"] + moment.real) / v["m_2"]
        alpha = X - v[f"beta_{pose}"] * Z
        draw.put(Kind.LENGTH, **{f"X_2{pose}": X, f"Z_2{pose}": Z, f"alpha_{pose}": alpha})
