"""A matplotlib figure as one inline ``<svg>``: responsive, named, with ids of its own.

Matplotlib writes a stand-alone file. Inside a page its ids would collide between figures, its
``<style>`` would leak onto the page and its fixed size would defeat small screens; six decimals of
a pixel and an element for each point multiply the size. `inline_svg` removes all that and leaves
text as text, so that it is set in the font of the page and can be selected.
"""

from __future__ import annotations

import re
from io import StringIO

from markupsafe import Markup, escape
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

_ATTRIBUTE = re.compile(r' (d|x|y|width|height|transform|points)="([^"]*)"')
_DECIMAL = re.compile(r"-?\d+\.\d+")
_BREAK = re.compile(r"\s+(?=[A-Za-z])|(?<=[A-Za-z])\s+|\s+$")
_LEVEL = re.compile(r"M(\S+) (\S+?)L(\S+) \2(?=[MLz]|$)")
_FONT = re.compile(r"font-family: [^;\"]*;? ?")
_NO_TURN = re.compile(r' transform="rotate\(-?0 [^"]*\)"')
_ID = re.compile(r' id="([^"]*)"')
_REFERENCE = re.compile(r'url\(#([^)]*)\)|href="#([^"]*)"')
_USE = r'<use href="#(\S+)" x="(\S+)" y="(\S+)" style="([^"]*)"/>\s*'
_POINTS = re.compile(rf'{_USE}(?:<use href="#\1" x="\S+" y="\S+" style="\4"/>\s*)+')
_AT = re.compile(r'x="(\S+)" y="(\S+)"')
_TEXT = re.compile(r"(<text[^>]*>)([^<]*)(</text>)")


def inline_svg(figure: Figure, *, name: str, label: str) -> Markup:
    """Draw a figure as an ``<svg>`` element to put into a page.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Drawn at 72 dots per inch: one unit of the picture is one CSS pixel.
    name : str
        Prefix of the ids in the picture, unique in the page.
    label : str
        Text alternative; says in numbers what the picture shows.

    Returns
    -------
    markupsafe.Markup
    """
    FigureCanvasSVG(figure)
    file = StringIO()
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    figure.savefig(file, format="svg", dpi=72, metadata=nothing, transparent=True)
    text = file.getvalue()
    body = text[text.index(">", text.index("<svg")) + 1 :]
    body = re.sub(r"<defs>\s*<style.*?</style>\s*</defs>", "", body, count=1, flags=re.DOTALL)
    body = _POINTS.sub(_as_markers, body.replace("xlink:href", "href"))
    body = _ATTRIBUTE.sub(_short_attribute, _own_ids(body, name))
    body = _NO_TURN.sub("", _FONT.sub("", re.sub(r"<g[^>]*/>", "", body)))
    body = re.sub(r">\s+<", "><", _TEXT.sub(_with_subscripts, body).strip())
    width, height = (72 * size for size in figure.get_size_inches())
    opening = (
        f'<svg class="plot" viewBox="0 0 {width:.0f} {height:.0f}" role="img"'
        f' style="max-width:{1.35 * width:.0f}px" aria-label="{escape(label)}">'
    )
    return Markup(opening + body)  # the label is escaped, the rest is drawn here


def _as_markers(match: re.Match[str]) -> str:
    """One line with a marker at each point for a run of equal points."""
    points = " ".join(f"{x} {y}" for x, y in _AT.findall(match[0]))
    own = f"{match[1]}-{match.start()}"
    return (
        f'<marker id="{own}" overflow="visible" markerUnits="userSpaceOnUse" style="{match[4]}">'
        f'<use href="#{match[1]}"/></marker>'
        f'<polyline points="{points}" style="fill: none; marker: url(#{own})"/>'
    )


def _own_ids(body: str, name: str) -> str:
    """Drop the ids nothing refers to and number the others after ``name``."""
    used = [a or b for a, b in _REFERENCE.findall(body)]
    new = {old: f"{name}-{i}" for i, old in enumerate(dict.fromkeys(used))}
    body = _ID.sub(lambda m: f' id="{new[m[1]]}"' if m[1] in new else "", body)
    return _REFERENCE.sub(lambda m: f"url(#{new[m[1]]})" if m[1] else f'href="#{new[m[2]]}"', body)


def _short_attribute(match: re.Match[str]) -> str:
    """Two decimals of a pixel are plenty; line breaks go, level lines get shorter."""
    value = _DECIMAL.sub(_short_number, match[2])
    if match[1] == "d":
        value = _LEVEL.sub(r"M\1 \2H\3", _BREAK.sub("", value))
    return f' {match[1]}="{value}"'


def _short_number(match: re.Match[str]) -> str:
    text = f"{float(match[0]):.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _with_subscripts(match: re.Match[str]) -> str:
    """Set what follows an underscore smaller and lower."""
    head, mark, tail = match[2].partition("_")
    if not mark:
        return match[0]
    low, space, rest = tail.partition(" ")
    after = f'<tspan dy="-.17em">{space}{rest}</tspan>' if rest else ""
    lowered = f'<tspan dy=".22em" font-size=".76em">{low}</tspan>'
    return f"{match[1]}{head}{lowered}{after}{match[3]}"
