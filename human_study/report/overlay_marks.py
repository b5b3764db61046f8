"""How rows are told apart on an overlay, by shape and colour, and the lines of text around it, as SVG."""

import html
from collections.abc import Sequence

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#aa4499", "#7a5c00", "#332288", "#000000", "#6b6b6b")
"""Of rows of the report in order; people's first. The first ones after Okabe and Ito, for colour-blind readers, who
also have the shapes."""
_SHAPES = ("circle", "square", "triangle", "diamond", "triangle down")
_LINE = 18
"""Height of a line of the legend in pixels."""
_TITLE = 26
DASHES = ' stroke-dasharray="6 3"'
"""Of an agent's path."""


def mark(x: float, y: float, number: int, *, is_filled: bool) -> str:
    """The end of a path, or a mark, of the row with this number; a thin white edge keeps neighbours apart."""
    colour = COLOURS[number % len(COLOURS)]
    edge, width = ("white", 2) if is_filled else (colour, 1.8)
    paint = f'fill="{colour if is_filled else "white"}" stroke="{edge}" stroke-width="{width}" paint-order="stroke"'
    match _SHAPES[number % len(_SHAPES)]:
        case "circle":
            return f'<circle class="mark" cx="{x:.1f}" cy="{y:.1f}" r="5" {paint}/>'
        case "square":
            shape = "m-4.5 -4.5 h9 v9 h-9 z"
        case "triangle":
            shape = "m0 -5.8 l5.5 9.8 h-11 z"
        case "diamond":
            shape = "m0 -6.2 l6.2 6.2 l-6.2 6.2 l-6.2 -6.2 z"
        case _:
            shape = "m0 5.8 l5.5 -9.8 h-11 z"
    return f'<path class="mark" d="M{x:.1f} {y:.1f} {shape}" {paint}/>'


def line(points: str, number: int, *, is_dashed: bool) -> str:
    """A path of the row with this number."""
    colour = COLOURS[number % len(COLOURS)]
    dashes = DASHES if is_dashed else ""
    return f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.6" opacity=".75"{dashes}/>'


def start(x: float, y: float) -> str:
    """A cross where an episode starts, the same for everybody."""
    return f'<path d="M{x - 6:.1f} {y:.1f} h12 M{x:.1f} {y - 6:.1f} v12" stroke="black" stroke-width="2.2"/>'


def target(x: float, y: float, radius: float) -> str:
    """A right object, and a ring around it."""
    ring = "" if radius <= 0 else f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="none" stroke="black"'
    ring += "" if radius <= 0 else ' stroke-dasharray="5 4"/>'
    return ring + f'<path d="M{x - 5:.1f} {y - 5:.1f} l10 10 m-10 0 l10 -10" stroke="black" stroke-width="1.8"/>'


def scale_bar(metre: float, y: float) -> str:
    """A bar of a metre, or of five where a metre is short."""
    length = 1 if metre >= 30 else 5
    return (
        f'<path d="M10 {y:g} h{length * metre:.1f}" stroke="black" stroke-width="2"/>'
        f'<text x="{14 + length * metre:.1f}" y="{y + 4:g}">{length} m</text>'
    )


def legend(
    rows: Sequence[tuple[str, bool | None]], *, has_start: bool, has_targets: bool, has_floor: bool
) -> list[str]:
    """The lines below an overlay, each drawn from its own corner.

    Args:
        rows: Text of each row in order, and whether its paths are dashed; None = it has marks and no paths.
        has_start: Whether the start is drawn.
        has_targets: Whether the right objects are.
        has_floor: Whether the free floor is.
    """
    lines = []
    for number, (text, is_dashed) in enumerate(rows):
        sample = "" if is_dashed is None else line("0,0 22,0", number, is_dashed=is_dashed)
        lines.append(f'{sample}{mark(22, 0, number, is_filled=True)}<text x="34" y="4">{html.escape(text)}</text>')
    signs = "Filled: success. Open: failure."
    lines.append(f'<text x="34" y="4">{signs}</text>')
    if has_start:
        lines.append(f'{start(22, 0)}<text x="34" y="4">Start</text>')
    if has_targets:
        lines.append(f'{target(22, 0, 0)}<text x="34" y="4">Right object; the ring is 1 m around its middle</text>')
    ground = "White: where the robot can stand. Grey: walls, furniture, outside."
    if not has_floor:
        ground = "The floor is not drawn: the report was made without --dataset."
    return [*lines, f'<text x="34" y="4">{ground}</text>']


def framed(title: str, picture: str, lines: Sequence[str], *, size: tuple[int, int]) -> str:
    """The whole file: a title, the picture, and the legend.

    Args:
        title: Above the picture.
        picture: From (0, 0).
        lines: Of the legend.
        size: (width, height) of the picture in pixels.
    """
    width, height = size
    text = html.escape(title)
    below = _TITLE + height + 20
    rows = "".join(f'<g transform="translate(10 {below + _LINE * n})">{one}</g>' for n, one in enumerate(lines))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{max(width, 460) + 20}" height="{below + _LINE * len(lines)}" '
        f'role="img" aria-label="{text}" font-family="sans-serif" font-size="12">'
        f'<rect width="100%" height="100%" fill="white"/>'
        f'<text x="10" y="18" font-size="13" font-weight="bold">{text}</text>'
        f'<g transform="translate(10 {_TITLE})">{picture}'
        f'<rect width="{width}" height="{height}" fill="none" stroke="#8a8a86"/></g>{rows}</svg>\n'
    )
