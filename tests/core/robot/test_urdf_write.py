# SPDX-License-Identifier: Apache-2.0
"""Only numbers inside the ``<inertial>`` of the named links change; every other byte stays."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comcal.errors import UrdfError
from comcal.robot.urdf import parse_urdf, read_urdf
from comcal.robot.urdf_write import InertialEdit, write_inertials

INERTIA = '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>'
ORIGINS = [
    "",
    '<origin xyz="0.1 -0.2  0.3" rpy="0.1 0 0"/>',
    "<origin rpy='0 0.2 0' xyz='0.1\t-0.2 0.3'></origin>",
    '<origin rpy="0 0 1"/>',
    '<origin\n   xyz = " 0.1 -0.2 0.3 "\n/>',
    '<!-- <origin xyz="7 7 7"/> --><origin xyz="1e-1 -2E-1 3e-1"/>',
]
BETWEEN = [
    "",
    "\n  <!-- <inertial><origin xyz='9 9 9'/><mass value='9'/></inertial> -->\n",
    "<![CDATA[<inertial>]]>",
    '<gazebo reference="a"><link name="a"><inertial><mass value="5"/></inertial></link></gazebo>',
    "<?keep this?>\t\t",
    "<visual>\n<origin xyz='4 5 6'/><geometry><box size=\"1 1 1\"/></geometry></visual>",
]
NUMBER = st.floats(-2.0, 2.0, allow_nan=False)


def urdf(pieces: list[str], origins: list[str], declaration: str) -> tuple[list[str], list[str]]:
    """Return the outside pieces of a URDF and the inertials between them."""
    outside = [f"{declaration}<robot name='r' xmlns:xacro='http://www.ros.org/wiki/xacro'>"]
    inside = []
    for i, (piece, origin) in enumerate(zip(pieces, origins, strict=True)):
        in_link = piece if "gazebo" not in piece else ""
        outside[-1] += piece if not in_link and piece else ""
        outside[-1] += f'<link name=" l{i} ">{in_link}'
        inside.append(f"<inertial >\n    {origin}<mass value='{i + 1}.50'/>{INERTIA}</inertial>")
        end = "<inertial><mass value='77'/></inertial>" if i == 1 else ""
        outside.append(f"{end}</link>")
    outside[-1] += "".join(
        f'<joint name="j{i}" type="fixed"><parent link="l0"/><child link="l{i}"/></joint>'
        for i in range(1, len(pieces))
    )
    outside[-1] += "</robot><!-- the end, <inertial> -->\n"
    return outside, inside


def joined(outside: list[str], inside: list[str]) -> str:
    return "".join(a + b for a, b in zip(outside, [*inside, ""], strict=True))


@settings(max_examples=80)
@given(
    pieces=st.lists(st.sampled_from(BETWEEN), min_size=1, max_size=4),
    data=st.data(),
    declaration=st.sampled_from(
        ["", '<?xml version="1.0" encoding="utf-8"?>\n', "<?xml version='0.1' ?>", "\ufeff"]
    ),
    newline=st.sampled_from(["\n", "\r\n"]),
)
def test_bytes_outside_the_inertials_are_identical(pieces, data, declaration, newline) -> None:
    origins = [data.draw(st.sampled_from(ORIGINS)) for _ in pieces]
    outside, inside = urdf(pieces, origins, declaration)
    raw = joined(outside, inside).replace("\n", newline).encode()
    edited = data.draw(st.sets(st.integers(0, len(pieces) - 1)))
    com = {i: data.draw(st.tuples(NUMBER, NUMBER, NUMBER)) for i in edited}
    new = write_inertials(raw, "r.urdf", [InertialEdit(f"l{i}", com[i]) for i in edited])

    rest = new
    for i, piece in enumerate(outside):
        fixed = piece.replace("\n", newline).encode()
        assert rest.startswith(fixed)
        rest = rest[len(fixed) :]
        if i < len(inside):
            end = rest.index(b"</inertial>") + len(b"</inertial>")
            if i not in edited:
                assert rest[:end] == inside[i].replace("\n", newline).encode()
            rest = rest[end:]
    assert rest == b""
    before, after = parse_urdf(raw, "r"), parse_urdf(new, "r")
    for i, (old, found) in enumerate(zip(before.links, after.links, strict=True)):
        np.testing.assert_allclose(found.com, com.get(i, old.com), atol=1e-8)
        assert found.mass == old.mass
        np.testing.assert_array_equal(found.inertia, old.inertia)


def simple(inertial: str) -> bytes:
    return f'<robot name="r"><link name="a">{inertial}</link></robot>'.encode()


def test_a_missing_origin_is_set_off_like_the_first_child() -> None:
    raw = simple("\r\n  <inertial>\r\n    <mass value='1'/>\r\n  </inertial>\r\n")
    new = write_inertials(raw, "r", [InertialEdit("a", (0.0, 0.5, 0.0))])
    assert b'<inertial>\r\n    <origin xyz="0 0.5 0"/>\r\n    <mass' in new


def test_numbers_that_stay_keep_the_way_they_are_written() -> None:
    raw = simple('<inertial><origin xyz="0.10  +2.0e-1 .3"/><mass value="1"/></inertial>')
    new = write_inertials(raw, "r", [InertialEdit("a", (0.1, None, 0.4))])
    assert b'xyz="0.10  +2.0e-1 0.4"' in new
    assert write_inertials(raw, "r", [InertialEdit("a", (0.1, 0.2, 0.3))]) == raw


def test_a_factor_multiplies_mass_and_inertia_and_nothing_else() -> None:
    raw = simple(
        f"<inertial><origin xyz='1 2 3' rpy='0.3 0 0'/><mass value='2'/>{INERTIA}</inertial>"
    )
    new = write_inertials(raw, "r", [InertialEdit("a", factor=1.5)])
    (old,), (link,) = parse_urdf(raw, "r").links, parse_urdf(new, "r").links
    assert link.mass == 3.0
    np.testing.assert_allclose(link.inertia, 1.5 * old.inertia, atol=1e-12)
    np.testing.assert_array_equal(link.com, old.com)


def test_no_inertial_is_ever_invented() -> None:
    with pytest.raises(UrdfError, match="no <inertial>"):
        write_inertials(simple("<visual/>"), "r.urdf", [InertialEdit("a", (1.0, 0.0, 0.0))])


def test_an_empty_inertial_is_refused_as_in_reading() -> None:
    with pytest.raises(UrdfError, match="no <mass>"):
        write_inertials(simple("<inertial/>"), "r.urdf", [])


def test_character_references_are_refused_with_their_line() -> None:
    raw = simple('\n<inertial><origin xyz="0&#46;5 0 0"/><mass value="1"/></inertial>')
    with pytest.raises(UrdfError, match="line 2"):
        write_inertials(raw, "r.urdf", [InertialEdit("a", (1.0, 0.0, 0.0))])


def test_encodings_without_ascii_are_refused() -> None:
    raw = simple("<inertial><mass value='1'/></inertial>").decode().encode("utf-16")
    with pytest.raises(UrdfError, match="UTF-8"):
        write_inertials(raw, "r.urdf", [InertialEdit("a", (1.0, 0.0, 0.0))])


@pytest.mark.parametrize("name", ["talos", "g1", "icub", "romeo"])
def test_published_robots_change_in_their_inertials_alone(
    name: str, example_urdf: Callable[[str], Path]
) -> None:
    path = example_urdf(name)
    raw, tree = path.read_bytes(), read_urdf(path)
    rng = np.random.default_rng(4)
    moved = {
        link.name: link.com + 0.01 * rng.standard_normal(3)
        for link in tree.links
        if link.has_inertial
    }
    edits = [InertialEdit(k, (float(c[0]), float(c[1]), float(c[2]))) for k, c in moved.items()]
    new = write_inertials(raw, path.name, edits)
    for link in parse_urdf(new, path.name).links:
        np.testing.assert_allclose(link.com, moved.get(link.name, link.com), atol=1e-8)
    block = re.compile(rb"<inertial>.*?</inertial>", re.DOTALL)
    assert block.sub(b"", new) == block.sub(b"", raw)
