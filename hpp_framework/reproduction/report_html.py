"""Small pieces of HTML: text is escaped, what is already markup is not."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Sequence
from dataclasses import dataclass

from hpp_framework.evaluation.statistics import Estimate

DASH = "\u2013"
"""What tables show where there is no number."""


class Markup(str):
    """Text that is HTML already."""

    __slots__ = ()


VOID = frozenset({"img", "input", "br", "source"})


def tag(name: str, *content: str | None, **attributes: str | bool | None) -> Markup:
    """Return an element.

    Args:
        name: of the element.
        content: its children; text is escaped, :class:`Markup` kept, None left out.
        attributes: ``class_`` for class, underscores for dashes; None and False leave one out.
    """
    given = "".join(_attribute(key, value) for key, value in attributes.items() if value not in (None, False))
    if name in VOID:
        return Markup(f"<{name}{given}>")
    return Markup(f"<{name}{given}>{''.join(escaped(each) for each in content if each is not None)}</{name}>")


def join(*parts: str | None) -> Markup:
    """Return pieces one after another, one a line; text is escaped, None left out."""
    return Markup("\n".join(escaped(each) for each in parts if each is not None))


def escaped(text: str) -> str:
    """Return text as HTML shows it, and markup as it is."""
    return text if isinstance(text, Markup) else html.escape(text)


def data_uri(content: bytes, kind: str) -> str:
    """Return a file as an address that holds it, e.g. of kind ``"image/png"``."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def anchor(text: str) -> str:
    """Return a name that links can lead to."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "part"


def section(name: str, title: str, *content: str | None, level: int = 2) -> Markup:
    """Return a part of the page with a heading that links to itself."""
    head = tag(f"h{level}", tag("a", title, href=f"#{name}"))
    return tag("section", head, "\n", join(*content), id=name)


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        title: its head.
        hint: what it means, shown when pointed at.
        number: whether it is set to the right.
    """

    title: str
    hint: str = ""
    number: bool = True


def table(columns: Sequence[Column], rows: Sequence[Sequence[str]], *, label: str) -> Markup:
    """Return a table in a box of its own, which scrolls where the page is too narrow.

    Args:
        columns: their heads.
        rows: cells; text or markup. The first of each row is its head.
        label: what the table is, for those who hear the page.
    """
    head = tag("tr", *(_head(column) for column in columns))
    body = [tag("tr", *(_cell(i, columns, cell) for i, cell in enumerate(row))) for row in rows]
    whole = tag("table", tag("thead", head), "\n", tag("tbody", join(*body)))
    return tag("div", whole, class_="scroll", tabindex="0", role="region", aria_label=label)


def details(summary: str, *content: str | None, open_: bool = False) -> Markup:
    """Return content that is folded away below a line of text."""
    return tag("details", tag("summary", summary), join(*content), open=open_)


def note(text: str) -> Markup:
    """Return a line that says what is missing, or how to read something."""
    return tag("p", text, class_="note")


def number(value: float | None, digits: int = 2, *, sign: bool = False) -> str:
    """Return a number as tables show it; a dash for none."""
    return DASH if value is None else f"{value:{'+' if sign else ''}.{digits}f}".replace("-", "\u2212")


def p_value(value: float | None) -> str:
    """Return a p value with as many digits as mean anything."""
    return "< 0.001" if value is not None and value < 0.001 else number(value, 3)


def interval(estimate: Sequence[float] | Estimate | None, *, sign: bool = False) -> str:
    """Return a value with its 95 % interval: markup, the interval smaller."""
    if estimate is None:
        return DASH
    values = estimate.as_list() if isinstance(estimate, Estimate) else estimate
    value, low, high = (number(each, 2, sign=sign) for each in values)
    return Markup(f"{value} <small>{low} to {high}</small>")


def _attribute(key: str, value: str | bool | None) -> str:
    name = key.rstrip("_").replace("_", "-")
    return f" {name}" if value is True else f' {name}="{html.escape(str(value))}"'


def _head(column: Column) -> Markup:
    return tag(
        "th", column.title, scope="col", class_="number" if column.number else None, title=column.hint or None
    )


def _cell(place: int, columns: Sequence[Column], content: str) -> Markup:
    kind = "number" if columns[place].number else None
    return tag("td", content, class_=kind) if place else tag("th", content, scope="row", class_=kind)
