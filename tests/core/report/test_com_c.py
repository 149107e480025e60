# SPDX-License-Identifier: Apache-2.0
"""Exported C: the same CoM and Jacobian as the kinematics, whatever the robot and its names.

Not covered: other compilers than those called gcc and clang here, and speed (tests/bench).
"""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from comcal.errors import UrdfError
from comcal.robot.frames import rotation_about, rotation_from_rpy, transform_from
from comcal.robot.kinematics import place_links
from comcal.robot.tree import Joint, JointType, Link, Mimic, Tree
from comcal.robot.urdf import read_urdf
from comcal.statics.com import com_jacobian, total_com
from comcal.workflow.export_c import export_c

STRICT = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]
COMPILERS = [compiler for compiler in ("gcc", "clang") if shutil.which(compiler)]
needs_compiler = pytest.mark.skipif(not COMPILERS, reason="neither gcc nor clang on this machine")


@pytest.fixture
def build(tmp_path):
    """Compile exported files without one warning: a test program, or a library of functions."""

    def build(files, *options, compiler=COMPILERS[0] if COMPILERS else ""):
        for name, text in files.items():
            (tmp_path / name).write_bytes(text.encode("ascii"))
        target = tmp_path / "built"
        target.unlink(missing_ok=True)  # a loaded library is never written over
        sources = [tmp_path / name for name in files if name.endswith(".c")]
        command = [compiler, *STRICT, *options, *sources, "-lm", "-o", target]
        subprocess.run(command, check=True)
        return target

    return build


@pytest.fixture
def exported(build, tmp_path_factory):
    """Return CoM, CoM and J of a tree as the exported library computes them, pose by pose."""

    def exported(tree, poses):
        files = {name: text for name, text in export_c(tree, "r").items() if "test" not in name}
        built = build(files, "-shared", "-fPIC")
        loaded = ctypes.CDLL(str(shutil.move(built, tmp_path_factory.mktemp("lib") / "r.so")))
        alone, both = np.full((len(poses), 3), np.nan), np.full((len(poses), 3), np.nan)
        J = np.full((len(poses), 3, len(tree.joint_names)), np.nan)
        for i, q in enumerate(poses):
            at = [a.ctypes.data_as(ctypes.c_void_p) for a in (q, alone[i], both[i], J[i])]
            loaded.r_com(*at[:2])
            loaded.r_com_jacobian(at[0], *at[2:])
        return alone, both, J

    return exported


def random_tree(rng: np.random.Generator, n: int, *, tidy: bool) -> Tree:
    """Every joint type, mimics before and behind their leader, links without mass.

    A *tidy* tree is made of quarter turns and axes along coordinates, as most URDFs are.
    """
    turn = np.pi / 2
    links, joints, movable = [], [], []
    for k in range(n + 1):
        mass = float(rng.uniform(0.1, 5)) if rng.uniform() < 0.8 else 0.0
        links.append(Link(f"link{k}", mass, rng.normal(size=3) * (mass > 0), np.eye(3)))
    for k in range(1, n + 1):
        kind = list(JointType)[int(rng.integers(4))]
        rpy = turn * rng.integers(-2, 3, 3) if tidy else rng.uniform(-3, 3, 3)
        axis = rng.normal(size=3)
        if tidy:
            axis = np.eye(3)[int(rng.integers(3))] * rng.choice([-1.0, 1.0])
        axis = axis / np.linalg.norm(axis) * (kind is not JointType.FIXED)
        T = transform_from(rotation_from_rpy(rpy), rng.normal(size=3))
        parent = f"link{rng.integers(max(0, k - 3), k)}"
        joints.append(Joint(f"joint{k}", kind, parent, f"link{k}", T, axis))
        if kind is not JointType.FIXED:
            movable.append(k - 1)
    leader = int(rng.choice(movable)) if movable else -1
    for i in movable:
        if i != leader and rng.uniform() < 0.3:
            multiplier = float(rng.choice([-1.0, 1.0, rng.normal()]))
            mimic = Mimic(joints[leader].name, multiplier, float(rng.choice([0.0, rng.normal()])))
            joints[i] = replace(joints[i], mimic=mimic)
    links[-1] = replace(links[-1], mass=1.0)
    return Tree("random", tuple(links), tuple(joints))


def random_trees(count: int = 20) -> list[Tree]:
    trees, seed = [], 0
    while len(trees) < count:
        rng = np.random.default_rng(seed)
        tree = random_tree(rng, 3 + seed % 11, tidy=seed % 2 == 0)
        trees += [tree] if tree.joint_names else []
        seed += 1
    return trees


def assert_same(tree, exported, poses, com, J):
    alone, both, found = exported(tree, poses)
    np.testing.assert_array_equal(alone, both)
    np.testing.assert_allclose(both, com, rtol=0, atol=1e-12 * max(1.0, abs(com).max()))
    np.testing.assert_allclose(found, J, rtol=0, atol=1e-12 * max(1.0, abs(J).max()))


@needs_compiler
@pytest.mark.parametrize("index", range(20))
def test_random_trees_agree_with_the_placed_links(index, exported):
    tree = random_trees()[index]
    poses = np.random.default_rng(index).uniform(-3, 3, (4, len(tree.joint_names)))
    com, J = total_com(tree, poses), com_jacobian(tree, poses)
    np.testing.assert_allclose(com, place_links(tree, poses).total_com(), rtol=0, atol=1e-13)
    assert_same(tree, exported, poses, com, J)


def test_the_random_trees_hold_every_case():
    trees = random_trees()
    joints = [joint for tree in trees for joint in tree.joints]
    mimics = [joint for joint in joints if joint.mimic]
    assert {joint.kind for joint in joints} == set(JointType)
    assert {joint.kind for joint in mimics} >= {JointType.REVOLUTE, JointType.PRISMATIC}
    late = [
        tree.joint_index[j.mimic.joint] > tree.joint_index[j.name]
        for tree in trees
        for j in tree.joints
        if j.mimic
    ]
    assert set(late) == {False, True}
    assert any(tree.masses[tree.subtree(j.name)].sum() == 0 for tree in trees for j in tree.joints)


@pytest.mark.parametrize("tree", random_trees(6), ids=lambda tree: f"{len(tree.links)}_links")
def test_the_jacobian_is_how_the_com_moves(tree):
    q = np.random.default_rng(1).uniform(-2, 2, len(tree.joint_names))
    J = com_jacobian(tree, q)
    step = 1e-6
    ahead, behind = (place_links(tree, q + d * np.eye(len(q))).total_com() for d in (step, -step))
    np.testing.assert_allclose(J[0].T, (ahead - behind) / (2 * step), rtol=0, atol=1e-8)


@needs_compiler
@pytest.mark.parametrize("name", ["talos", "g1", "icub", "romeo"])
def test_published_humanoids_agree_with_pinocchio(name, example_urdf, exported):
    pin = pytest.importorskip("pinocchio")
    path = example_urdf(name)
    tree = read_urdf(path)
    poses = np.random.default_rng(2).uniform(-1, 1, (5, len(tree.joint_names)))
    model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    data = model.createData()
    com, J = np.empty((5, 3)), np.zeros((5, 3, len(tree.joint_names)))
    column = {joint: j for j, joint in enumerate(tree.joint_names)}
    movable = [joint for joint in tree.joints if joint.is_movable]
    for i, q in enumerate(poses):
        q_pin = pin.neutral(model)
        for joint in movable:
            leader, pace, offset = joint.name, 1.0, 0.0
            if joint.mimic:
                leader, pace, offset = joint.mimic.joint, joint.mimic.multiplier, joint.mimic.offset
            value, pin_joint = pace * q[column[leader]] + offset, model.getJointId(joint.name)
            at, size = model.joints[pin_joint].idx_q, model.joints[pin_joint].nq
            q_pin[at : at + size] = [value] if size == 1 else [np.cos(value), np.sin(value)]
        J_pin = pin.jacobianCenterOfMass(model, data, q_pin)
        com[i] = data.com[0]
        for joint in movable:
            pace = joint.mimic.multiplier if joint.mimic else 1.0
            leader = joint.mimic.joint if joint.mimic else joint.name
            v = model.joints[model.getJointId(joint.name)].idx_v
            J[i, :, column[leader]] += pace * J_pin[:, v]
    assert_same(tree, exported, poses, com, J)


@needs_compiler
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("robot", ["table1", "biped14", "odd"])
def test_harness_passes_and_says_so(robot, compiler, request, build, odd):
    if robot == "odd":
        tree = odd.odd_biped(np.random.default_rng(5)).tree
    else:
        tree = request.getfixturevalue(robot).robot.tree
    program = build(export_c(tree, robot), "-O2", compiler=compiler)
    run = subprocess.run([program], capture_output=True, text=True)
    assert run.returncode == 0, run.stdout
    assert f"{robot}_com: ok, 5 poses" in run.stdout


@needs_compiler
def test_harness_fails_when_any_constant_of_the_source_is_altered(build, odd):
    files = export_c(odd.odd_biped(np.random.default_rng(6)).tree, "odd")
    source = without_comments(files["odd_com.c"])
    constants = list(re.finditer(r"(?<![\w.])\d+\.\d+(?:e[+-]?\d+)?", source))
    assert len(constants) > 50
    for constant in constants[:: len(constants) // 9]:
        start, end = constant.span()
        altered = f"{float(constant[0]) * (1 + 1e-6) + 1e-9!r}"
        broken = {**files, "odd_com.c": source[:start] + altered + source[end:]}
        run = subprocess.run([build(broken, "-O0")], capture_output=True, text=True)
        assert run.returncode == 1, f"{constant[0]} -> {altered}: {run.stdout}"
        assert "FAILED" in run.stdout


def chain(*names: str, axes=((0.0, 1.0, 0.0),), mass: float = 1.0) -> Tree:
    """Links in a row, half a metre apart."""
    links = [Link("base", mass, np.zeros(3), np.eye(3))]
    joints = []
    T = transform_from(np.eye(3), [0.0, 0.0, 0.5])
    for k, name in enumerate(names):
        links.append(Link(f"link of {name}", mass, np.array([0.1, 0.2, 0.3]), np.eye(3)))
        joints.append(
            Joint(name, JointType.REVOLUTE, links[k].name, links[k + 1].name, T,
                  np.array(axes[k % len(axes)]))
        )  # fmt: skip
    return Tree("row", tuple(links), tuple(joints))


ODD_NAMES = (
    "l knee",
    "l_knee",
    "L-KNEE",
    "l_knee_2",
    "*/ int x; /*",
    "??/",
    'a"b\\',
    "7",
    "膝",
    "",
)


@needs_compiler
def test_any_name_compiles_and_comes_back(build):
    tree = replace(chain(*ODD_NAMES), name="bad */ name\\")
    files = export_c(tree, "7 of 9!")
    assert set(files) == {f"robot_7_of_9_com{end}" for end in (".h", ".c", "_test.c")}
    library = build({n: t for n, t in files.items() if "test" not in n}, "-shared", "-fPIC")
    names = (ctypes.c_char_p * len(ODD_NAMES)).in_dll(
        ctypes.CDLL(str(library)), "robot_7_of_9_joint_names"
    )
    assert tuple(name.decode() for name in names) == ODD_NAMES
    enumerators = re.findall(r"^ +(ROBOT_7_OF_9_Q_\w+)", files["robot_7_of_9_com.h"], re.M)
    assert len(set(enumerators)) == len(ODD_NAMES)


def test_the_text_is_the_same_each_time_and_says_where_it_came_from(biped14):
    tree = biped14.robot.tree
    files = export_c(tree, "b", origin="biped14.urdf, sha256 0123abcd")
    assert files == export_c(tree, "b", origin="biped14.urdf, sha256 0123abcd")
    for text in files.values():
        assert "biped14.urdf, sha256 0123abcd" in text
        assert repr(tree.links[0].name) in text
        assert max(map(len, text.splitlines())) <= 120
    assert f"#define B_MASS {tree.total_mass!r}" in files["b_com.h"]


@needs_compiler
def test_joints_that_move_no_mass_have_a_zero_column_and_cost_nothing(exported):
    tree = chain("carries", "turns a camera")
    tree = replace(tree, links=(*tree.links[:2], replace(tree.links[2], mass=0.0)))
    assert "q[1]" not in export_c(tree, "r")["r_com.c"]
    alone, _, J = exported(tree, np.array([[0.3, 0.4]]))
    assert np.array_equal(J[0, :, 1], np.zeros(3))
    np.testing.assert_allclose(alone, place_links(tree, [[0.3, 0.4]]).total_com(), atol=1e-15)


@needs_compiler
def test_a_robot_whose_joints_all_move_no_mass_compiles(exported):
    tree = chain("turns a camera")
    tree = replace(tree, links=(tree.links[0], replace(tree.links[1], mass=0.0)))
    alone, _, J = exported(tree, np.array([[0.3]]))
    assert not alone.any()
    assert not J.any()


def without_comments(source: str) -> str:
    return re.sub(r"/\*.*?\*/", "", source, flags=re.S)


def test_joints_along_coordinate_axes_cost_four_products_and_no_other():
    x, y, z = np.eye(3)
    turned = rotation_about(x, np.pi / 2)  # leaves 6e-17 where zeros should be
    tree = chain("a", "b", "c", axes=(y, z, x))
    joints = tuple(
        replace(j, T_parent_joint=transform_from(turned, j.T_parent_joint[:3, 3]))
        for j in tree.joints
    )
    source = without_comments(export_c(replace(tree, joints=joints), "r")["r_com.c"])
    com = source[source.index("void r_com(") : source.index("void r_com_jacobian(")]
    assert com.count("*") == 4 * len(joints)


@pytest.mark.parametrize(
    ("tree", "words"),
    [
        (replace(chain("a"), geometry_known=False), "no lengths"),
        (chain("a", mass=0.0), "no mass"),
        (chain("a", mass=float("nan")), "'base' has no mass"),
        (chain(), "no joint"),
    ],
    ids=["no lengths", "no mass", "unknown mass", "no joint"],
)
def test_what_has_no_com_that_moves_is_refused(tree, words):
    with pytest.raises(UrdfError, match=words):
        export_c(tree, "r")
