# SPDX-License-Identifier: Apache-2.0
"""XML elements of a URDF, read strictly: every refusal names ``file:line``.

A misspelt attribute (``xzy=``) would silently leave a zero; here it is an error.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Protocol, cast

import numpy as np
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # a compiled module

from comcal.errors import UrdfError
from comcal.robot.frames import rotation_from_rpy, transform_from
from comcal.robot.tree import Array
from comcal.robot.units import LARGEST, NUMBER

# Many URDFs call themselves XML 0.0; the parsers of ROS do not look.
_OLD_DECLARATION = re.compile(rb"\A<\?xml version=[\"']0\.\d[\"']")
_NEW_DECLARATION = b'<?xml version="1.0"'
_XACRO = "{http://www.ros.org/wiki/xacro}"
_INFINITE = {"inf": np.inf, "+inf": np.inf, "-inf": -np.inf}


class Element(Protocol):
    """What is used of an lxml element (lxml has neither a public name nor types for it)."""

    @property
    def tag(self) -> str:
        """Name of the element."""
        ...

    @property
    def sourceline(self) -> int | None:
        """Line in the file, from 1."""
        ...

    @property
    def attrib(self) -> Mapping[str, str]:
        """All attributes."""
        ...

    def get(self, key: str) -> str | None:
        """Return an attribute, None where it is absent."""
        ...

    def iterchildren(self, *tags: str) -> Iterator[Element]:
        """Iterate over the direct children with one of *tags*."""
        ...

    def iter(self) -> Iterator[Element]:
        """Iterate over the element and everything below it."""
        ...


@dataclass(frozen=True)
class UrdfXml:
    """The XML of a URDF and the name it has in messages.

    Parameters
    ----------
    name : str
        File name.
    root : Element
        The ``<robot>`` element.
    notes : list of str
        What is doubtful in the file and how it was read, collected while reading.
    """

    name: str
    root: Element
    notes: list[str] = field(default_factory=list[str])

    def where(self, element: Element) -> str:
        """Return ``file:line`` of *element*."""
        return f"{self.name}:{element.sourceline or 1}"

    def error(
        self,
        element: Element,
        what: str,
        *,
        measured: str = "",
        limit: str = "",
        next_step: str = "",
    ) -> UrdfError:
        """Return the error *what* at the place of *element*."""
        return UrdfError(
            what, where=self.where(element), measured=measured, limit=limit, next_step=next_step
        )

    def named(self, tag: str) -> Iterator[tuple[str, Element]]:
        """Yield name and element of every ``<tag>`` of the robot; names are unique."""
        first: dict[str, Element] = {}
        for element in self.root.iterchildren(tag):
            name = self.text(element, "name")
            if name in first:
                raise self.error(
                    element,
                    f"{tag} {name!r} is defined twice, first in line {first[name].sourceline}",
                    next_step="rename or remove one of them",
                )
            first[name] = element
            yield name, element

    def first_child(self, element: Element, tag: str) -> Element | None:
        """Return the ``<tag>`` of *element*, None where there is none.

        Of several, the first counts, as in the parsers of ROS, and a note says so.
        """
        children = list(element.iterchildren(tag))
        if len(children) > 1:
            self.notes.append(
                f"{self.where(children[1])}: a second <{tag}> in this <{element.tag}> is ignored"
            )
        return children[0] if children else None

    def required_child(self, element: Element, tag: str) -> Element:
        """Return the ``<tag>`` of *element*, which must be there."""
        child = self.first_child(element, tag)
        if child is None:
            raise self.error(element, f"this <{element.tag}> has no <{tag}>")
        return child

    def text(self, element: Element, attribute: str) -> str:
        """Return an attribute that must be there and not be empty."""
        text = (element.get(attribute) or "").strip()
        if not text:
            raise self.error(element, f"this <{element.tag}> has no {attribute}=")
        return text

    def expect_attributes(self, element: Element, allowed: Iterable[str]) -> None:
        """Refuse attributes other than *allowed*; those of other namespaces are nobody's."""
        known = list(allowed)
        for attribute in element.attrib:
            key = str(attribute)
            if key not in known and not key.startswith("{"):
                meant = get_close_matches(key, known, n=1)
                raise self.error(
                    element,
                    f"<{element.tag}> has no attribute {key!r}",
                    next_step=f"did you mean {meant[0]!r}?"
                    if meant
                    else f"possible are {', '.join(known)}",
                )

    def number(
        self,
        element: Element,
        attribute: str,
        default: float | None = None,
        *,
        endless: bool = False,
    ) -> float:
        """Return a finite number [SI]; *endless* allows ``inf`` too."""
        if default is not None and element.get(attribute) is None:
            return default
        text = self.text(element, attribute)
        if endless and text.lower() in _INFINITE:
            return _INFINITE[text.lower()]
        return self._finite(element, attribute, text)

    def vector(self, element: Element, attribute: str, default: tuple[float, ...]) -> Array:
        """Return as many finite numbers [SI] as *default* has."""
        text = element.get(attribute)
        if text is None:
            return np.array(default)
        words = text.split()
        if len(words) != len(default):
            raise self.error(
                element,
                f"{attribute}={text[:60]!r} of <{element.tag}> must hold {len(default)} numbers",
                measured=f"{len(words)} found",
            )
        return np.array([self._finite(element, attribute, word) for word in words])

    def origin(self, element: Element) -> Array:
        """Return the 4x4 pose ``<origin xyz rpy>`` of *element*, by default the identity."""
        origin = self.first_child(element, "origin")
        if origin is None:
            return np.eye(4)
        self.expect_attributes(origin, ("xyz", "rpy"))
        zero = (0.0, 0.0, 0.0)
        rpy = self.vector(origin, "rpy", zero)
        return transform_from(rotation_from_rpy(rpy), self.vector(origin, "xyz", zero))

    def _finite(self, element: Element, attribute: str, text: str) -> float:
        if not NUMBER.fullmatch(text):
            xacro = "$" in text
            raise self.error(
                element,
                f"{attribute}= of <{element.tag}> is not a finite number",
                measured=repr(text[:60]),
                next_step="expand the xacro file to plain URDF first"
                if xacro
                else "write a decimal number in SI units",
            )
        value = float(text)
        if not abs(value) <= LARGEST:
            raise self.error(
                element,
                f"{attribute}= of <{element.tag}> is too large to be real",
                measured=text[:60],
                limit=f"{LARGEST:g}",
            )
        return value


def read_xml(path: Path) -> UrdfXml:
    """Parse a URDF without touching the network or any other file.

    Raises
    ------
    UrdfError
        If the file is missing, not XML, has a DOCTYPE, or its root element is not ``<robot>``.
    """
    try:
        raw = path.read_bytes() if path.is_file() else None
    except OSError as error:
        raise UrdfError(f"cannot be read: {error.strerror}", where=str(path)) from error
    if raw is None:
        raise UrdfError(
            "there is no such URDF file", where=str(path), next_step="check the path `urdf:` names"
        )
    return parse_xml(raw, path.name)


def current_declaration(raw: bytes) -> bytes:
    """Return *raw* with the XML version 0.x that many URDFs claim read as 1.0; no byte moves."""
    return _OLD_DECLARATION.sub(_NEW_DECLARATION, raw)


def parse_xml(raw: bytes, name: str) -> UrdfXml:
    """Parse the bytes of a URDF; *name* is that of the file in messages.

    Raises
    ------
    UrdfError
        If it is not XML, has a DOCTYPE, or its root element is not ``<robot>``.
    """
    raw = current_declaration(raw)
    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        remove_comments=True,
        remove_pis=True,
    )
    try:
        tree = etree.ElementTree(etree.fromstring(raw, parser))
    except etree.XMLSyntaxError as error:
        raise UrdfError(
            f"not valid XML: {error.msg}", where=f"{name}:{error.lineno or 1}"
        ) from error
    if tree.docinfo.internalDTD is not None:
        raise UrdfError("a URDF has no DOCTYPE; entities are not expanded here", where=f"{name}:1")
    root = cast("Element", tree.getroot())
    xml = UrdfXml(name, root)
    if root.tag != "robot":
        raise xml.error(
            root,
            f"the root element is <{root.tag}>, not <robot>",
            next_step="give a URDF (SDF and MJCF are other formats)",
        )
    macro = next((e for e in root.iter() if str(e.tag).startswith(_XACRO)), None)
    if macro is not None:
        raise xml.error(
            macro,
            "this is xacro, a template of a URDF",
            next_step=f"expand it first: xacro {name} > {Path(name).stem}.urdf",
        )
    return xml
