# SPDX-License-Identifier: Apache-2.0
"""Elements of HTML and SVG as text, closed and escaped by construction."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

_VOID = frozenset({"meta"})


class Markup(str):
    """Text that is markup already and must not be escaped again."""

    __slots__ = ()


def element(tag: str, *children: str, **attributes: str | float) -> Markup:
    """Return one element.

    Parameters
    ----------
    tag : str
    *children : str
        Escaped, unless they are :class:`Markup`.
    **attributes : str or float
        ``class_`` is ``class``; other underscores become hyphens. Numbers get two decimals, which
        is a hundredth of a pixel.
    """
    words = "".join(
        f' {name.rstrip("_").replace("_", "-")}="{escape(_text(value))}"'
        for name, value in attributes.items()
    )
    inside = joined(*children)
    return Markup(f"<{tag}{words}/>" if tag in _VOID else f"<{tag}{words}>{inside}</{tag}>")


def joined(*children: str) -> Markup:
    """Return children one after the other, escaped unless they are markup."""
    return Markup("".join(c if isinstance(c, Markup) else escape(c, quote=False) for c in children))


def _text(value: str | float) -> str:
    if isinstance(value, str):
        return value
    return f"{value:.2f}".rstrip("0").rstrip(".")


def table(
    header: tuple[str, ...],
    rows: Sequence[tuple[str, ...]],
    *,
    wraps: bool = False,
) -> Markup:
    """Return a table that scrolls sideways in its own box where the window is narrow.

    Parameters
    ----------
    header : tuple of str
    rows : sequence of tuple of str
        The first cell of each is what the row is called.
    wraps : bool
        Whether cells hold sentences.
    """
    kind = {"class_": "words"} if wraps else {}
    head = element("tr", *(element("th", title, scope="col") for title in header))
    body = [
        element(
            "tr", element("th", row[0], scope="row"), *(element("td", c, **kind) for c in row[1:])
        )
        for row in rows
    ]
    whole = element("table", element("thead", head), element("tbody", *body))
    return element("div", whole, class_="scroll")
