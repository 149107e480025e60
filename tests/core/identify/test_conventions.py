# SPDX-License-Identifier: Apache-2.0
"""Readings of a table: which are the same model, which the fitted poses can tell apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from comcal.errors import ConfigError, RankError
from comcal.identify.convention_fit import (
    convention_spread,
    fit_convention,
    known_errors,
    predict_convention,
    rounding_spread,
)
from comcal.identify.convention_ranking import draw_tables, rank_conventions
from comcal.identify.conventions import (
    Closure,
    Convention,
    Conventions,
    Offset,
    Rounding,
    convention_matrix,
    same_models,
    stated_conventions,
)
from comcal.identify.conventions_file import read_conventions
from comcal.identify.known_com import KnownCom
from comcal.robot.frames import transform_from
from comcal.robot.kinematics import place_links
from comcal.robot.tree import Array, Joint, JointType, Link, Tree
from comcal.statics.sesc import SescChain, r_from_links, sesc_chain, sesc_jacobian

NAMES = ("ankle", "hip", "other_hip", "other_ankle", "shoulder")
TURN = Rounding()
DEG = np.pi / 180.0


def frontal_person() -> Tree:
    """Return foot - leg - trunk - (leg - foot, arm), all turning about y, with true lengths."""
    shape = [
        ("base", "leg", [0.0, 0.0, 0.08], 1.0, [0.02, 0.0, 0.04]),
        ("leg", "trunk", [0.01, 0.0, 0.85], 11.0, [0.01, 0.0, 0.5]),
        ("trunk", "other_leg", [0.18, 0.0, 0.0], 40.0, [0.09, 0.0, 0.3]),
        ("other_leg", "other_foot", [0.0, 0.0, -0.85], 11.0, [0.0, 0.0, -0.35]),
        ("trunk", "arm", [-0.1, 0.0, 0.5], 1.0, [0.0, 0.0, -0.04]),
    ]
    masses = {"base": 1.0, "leg": 11.0, "trunk": 40.0, "other_leg": 11.0, "other_foot": 1.0}
    links = [Link("base", 1.0, np.array([0.02, 0.0, 0.04]), np.eye(3))]
    joints: list[Joint] = []
    for name, (parent, child, p, _, _) in zip(NAMES, shape, strict=True):
        com = np.array([0.01, 0.0, -0.3 if child in {"arm", "other_leg"} else 0.3])
        links.append(Link(child, masses.get(child, 4.0), com, np.eye(3)))
        T = transform_from(np.eye(3), p)
        joints.append(Joint(name, JointType.CONTINUOUS, parent, child, T, np.array([0, 1.0, 0])))
    return Tree("person", tuple(links), tuple(joints))


def poses(tree: Tree, n: int, seed: int, n_double: int = 2) -> tuple[Array, Array]:
    """Return joint positions and medio-lateral CoM; the first poses stand on both feet."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-0.6, 0.6, (n, 5))
    a = rng.uniform(-0.06, 0.06, n_double)
    q[:n_double, :4] = np.stack([a, -a + 0.02, 0.01 - a, a - 0.03], axis=1)
    return q, place_links(tree, q).total_com()[:, 0]


def table(q: Array, com: Array, var: float = 0.0) -> KnownCom:
    n = len(q)
    return KnownCom(
        q=q,
        q_var=np.full(q.shape, var),
        pose=tuple(range(1, n + 1)),
        row=np.arange(n),
        component=np.zeros(n, dtype=np.intp),
        com=com,
        com_var=np.full(n, var),
    )


def all_signs(rounding: Rounding, closure: Closure | None = None) -> Conventions:
    return Conventions(
        orders={"right": (0, 1, 2, 3, 4), "swapped": (0, 2, 1, 3, 4)},
        free_signs=(1, 2, 3, 4),
        offsets=(Offset.UNKNOWN,),
        closure=closure,
        rounding=rounding,
        words=NAMES,
    )


@pytest.fixture
def tree() -> Tree:
    return frontal_person()


@pytest.fixture
def chain(tree: Tree) -> SescChain:
    return sesc_chain(tree, planar=True)


def test_exact_data_of_many_poses_single_out_the_true_reading(tree: Tree, chain: SescChain) -> None:
    q, com = poses(tree, 30, seed=1)
    # The table lists the columns of the hips exchanged and the arm turning the other way.
    printed = q[:, [0, 2, 1, 3, 4]] * np.array([1, 1, 1, 1, -1])

    ranking = rank_conventions(
        chain,
        all_signs(Rounding(0.02 * DEG, 1e-5)),
        table(printed, com),
        np.random.default_rng(0),
        draws=20,
    )

    best = ranking.chosen.convention
    assert best.order == "swapped"
    assert best.signs == (1, 1, 1, 1, -1)
    assert len(ranking.tied) == 1
    assert ranking.chosen.dof == 30 - ranking.chosen.unknowns


def test_coarse_rounding_of_few_poses_leaves_readings_tied(tree: Tree, chain: SescChain) -> None:
    q, com = poses(tree, 12, seed=2)
    ranking = rank_conventions(
        chain, all_signs(Rounding(3 * DEG, 0.003)), table(q, com), np.random.default_rng(0), 50
    )

    assert len(ranking.tied) > 1
    assert ranking.chosen in ranking.tied


def test_closure_refutes_readings_in_which_the_other_foot_is_not_flat(
    tree: Tree, chain: SescChain
) -> None:
    q, com = poses(tree, 16, seed=3, n_double=6)
    q[:6, :4] = np.array([1, -1, -1, 1]) * 4 * DEG
    com = place_links(tree, q).total_com()[:, 0]
    closure = Closure("other_foot", 6 * DEG, 0.5 * DEG)

    ranking = rank_conventions(
        chain, all_signs(Rounding(3 * DEG, 0.003), closure), table(q, com), np.random.default_rng(0)
    )

    assert ranking.two_feet == (1, 2, 3, 4, 5, 6)
    for scored in ranking.scored:
        gap = 4.0 * (np.array(scored.convention.signs[:4]) @ [1, -1, -1, 1])
        assert np.degrees(scored.gap_rms) == pytest.approx(abs(gap), abs=1e-6)
        assert scored.is_refuted == (gap != 0.0)
    assert ranking.closure_separates


def test_a_shifted_zero_of_an_angle_changes_no_prediction(tree: Tree, chain: SescChain) -> None:
    """Why the zero of the arms need not be among the conventions."""
    q, com = poses(tree, 20, seed=4)
    com = com + np.random.default_rng(4).normal(0, 0.01, 20)
    new, _ = poses(tree, 5, seed=5)
    shift = np.array([0.0, 0.0, 0.3, 0.0, -1.57])
    reading = Convention("right", (0, 1, 2, 3, 4), (1,) * 5, Offset.UNKNOWN)
    predicted = [
        predict_convention(
            chain,
            reading,
            fit_convention(chain, reading, table(q + s, com, 1e-6), TURN),
            table(new + s, np.zeros(5), 1e-6),
            TURN,
        )
        for s in (np.zeros(5), shift)
    ]

    np.testing.assert_allclose(predicted[0].com, predicted[1].com, atol=1e-9)
    np.testing.assert_allclose(predicted[0].half_width, predicted[1].half_width, rtol=1e-6)


def test_turning_every_sense_round_is_the_same_model(tree: Tree, chain: SescChain) -> None:
    q, com = poses(tree, 5, seed=6)
    readings = tuple(
        Convention("right", (0, 1, 2, 3, 4), signs, Offset.UNKNOWN)
        for signs in [(1, 1, -1, 1, 1), (-1, -1, 1, -1, -1), (1, -1, -1, 1, 1)]
    )

    groups = same_models(chain, readings, table(q, com))

    assert groups == ((readings[0], readings[1]), (readings[2],))


def test_zero_offset_is_a_smaller_model_than_an_unknown_one(tree: Tree, chain: SescChain) -> None:
    q, com = poses(tree, 5, seed=6)
    readings = tuple(Convention("right", (0, 1, 2, 3, 4), (1,) * 5, offset) for offset in Offset)

    assert len(same_models(chain, readings, table(q, com))) == 2
    assert not convention_matrix(chain, readings[0], q)[..., chain.root_columns].any()


def test_known_errors_of_angles_reach_the_com_through_the_jacobian(
    tree: Tree, chain: SescChain
) -> None:
    q, com = poses(tree, 4, seed=7)
    r = r_from_links(chain)
    reading = Convention("swapped", (0, 2, 1, 3, 4), (1, -1, 1, 1, -1), Offset.UNKNOWN)
    var = np.random.default_rng(7).uniform(1e-6, 1e-4, q.shape)
    known = KnownCom(
        q, var, (1, 2, 3, 4), np.arange(4), np.zeros(4, dtype=np.intp), com, np.full(4, 1e-6)
    )

    sigma = known_errors(chain, reading, known, TURN, r)

    read = reading.joint_positions(q)
    slope = sesc_jacobian(chain, read, r)[:, 0]
    expected = 1e-6 + np.sum(slope**2 * var[:, [0, 2, 1, 3, 4]], axis=1)
    np.testing.assert_allclose(sigma, np.sqrt(expected), rtol=1e-12)
    # Never less than what the rounding alone makes.
    rounded = known_errors(chain, reading, known, Rounding(0.1, 0.01), r)
    assert (rounded > sigma).all()


def test_tables_are_drawn_within_the_rounding(tree: Tree) -> None:
    q, com = poses(tree, 6, seed=8)
    q_drawn, com_drawn = draw_tables(
        tree, Rounding(0.01, 0.002), table(q, com), np.random.default_rng(0), 400
    )

    assert 0.0095 < np.abs(q_drawn - q).max() <= 0.01
    assert 0.0019 < np.abs(com_drawn - com).max() <= 0.002
    assert np.std(q_drawn - q) == pytest.approx(0.01 / np.sqrt(3), rel=0.03)


def test_tables_without_rounding_are_drawn_by_their_standard_errors(tree: Tree) -> None:
    q, com = poses(tree, 6, seed=8)
    q_drawn, com_drawn = draw_tables(
        tree, TURN, table(q, com, var=1e-4), np.random.default_rng(0), 400
    )

    assert np.std(q_drawn - q) == pytest.approx(0.01, rel=0.05)
    assert np.std(com_drawn - com) == pytest.approx(0.01, rel=0.05)


def test_spread_over_rounding_grows_with_the_rounding(tree: Tree, chain: SescChain) -> None:
    q, com = poses(tree, 20, seed=9)
    new = table(poses(tree, 3, seed=10)[0], np.full(3, np.nan))
    reading = Convention("right", (0, 1, 2, 3, 4), (1,) * 5, Offset.UNKNOWN)
    known = table(q, com, 1e-8)
    widths: list[Array] = []
    for half in (0.1, 0.2):
        rounding = Rounding(half * DEG, half * 1e-3)
        fit = fit_convention(chain, reading, known, rounding)
        low, high = rounding_spread(
            chain, reading, fit, known, new, rounding, np.random.default_rng(3), 300
        )
        widths.append(high - low)

    np.testing.assert_allclose(widths[1] / widths[0], 2.0, rtol=0.2)


def test_spread_over_readings_spans_their_predictions(tree: Tree, chain: SescChain) -> None:
    q, com = poses(tree, 20, seed=11)
    new = table(poses(tree, 3, seed=12)[0], np.full(3, np.nan))
    known = table(q, com, 1e-8)
    readings = [
        Convention("right", (0, 1, 2, 3, 4), (1, s, 1, 1, 1), Offset.UNKNOWN) for s in (1, -1)
    ]
    alone = [
        predict_convention(chain, r, fit_convention(chain, r, known, TURN), new, TURN).com
        for r in readings
    ]

    low, high = convention_spread(chain, readings, known, new, TURN)

    np.testing.assert_allclose(low, np.minimum(*alone))
    np.testing.assert_allclose(high, np.maximum(*alone))


def test_as_many_unknowns_as_poses_is_refused(tree: Tree, chain: SescChain) -> None:
    q, com = poses(tree, 8, seed=13)
    with pytest.raises(RankError, match="no pose can be predicted"):
        rank_conventions(
            chain, stated_conventions(tree), table(q, com), np.random.default_rng(0), 5
        )


FILE = """\
format: comcal-conventions/1
joints: {hip: the first hip}
orders:
  right: [ankle, hip, other_hip, other_ankle, shoulder]
  swapped: [ankle, other_hip, hip, other_ankle, shoulder]
signs: [hip, shoulder]
offset: [zero, unknown]
closure: {link: other_foot, two_feet_below: 5 deg, scatter: 1.5 deg}
rounding: {angle: 0.5 deg, length: 0.5 mm}
"""


def test_conventions_file_is_read(tree: Tree, tmp_path: Path) -> None:
    path = tmp_path / "conventions.yaml"
    path.write_text(FILE, encoding="utf-8")

    conventions = read_conventions(path, tree)

    assert conventions.orders == {"right": (0, 1, 2, 3, 4), "swapped": (0, 2, 1, 3, 4)}
    assert conventions.free_signs == (1, 4)
    assert conventions.offsets == (Offset.ZERO, Offset.UNKNOWN)
    assert conventions.closure == Closure(
        "other_foot", pytest.approx(5 * DEG), pytest.approx(1.5 * DEG)
    )
    assert conventions.rounding == Rounding(pytest.approx(0.5 * DEG), pytest.approx(5e-4))
    assert conventions.words[:2] == ("ankle", "the first hip")
    assert len(conventions.candidates()) == 16


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("signs: [hip", "signs: [hipp", r"conventions.yaml:6: .*'hipp'.*did you mean 'hip'"),
        ("[ankle, hip, other", "[ankle, ankle, other", r"conventions.yaml:4: .*every column once"),
        ("link: other_foot", "link: foot", r"conventions.yaml:8: .*no link 'foot'"),
        ("offset: [zero", "offset: [nought", r"conventions.yaml:7: "),
        ("rounding: {angle", "rounding: {angel", r"conventions.yaml:9: .*did you mean 'angle'"),
        ("angle: 0.5 deg", "angle: -0.5 deg", r"conventions.yaml:9: "),
        ("0.5 mm", "0.5 kg", r"conventions.yaml:9: .*length"),
        ("conventions/1", "conventions/2", r"conventions.yaml:1: "),
        ("{hip: the", "{hop: the", r"conventions.yaml:2: .*did you mean 'hip'"),
        ("orders:", "order:", r"conventions.yaml:3: .*did you mean 'orders'"),
    ],
)
def test_wrong_conventions_file_is_refused_with_its_line(
    tree: Tree, tmp_path: Path, old: str, new: str, message: str
) -> None:
    path = tmp_path / "conventions.yaml"
    path.write_text(FILE.replace(old, new), encoding="utf-8")
    with pytest.raises(ConfigError, match=message):
        read_conventions(path, tree)
