"""The one design system of all pages and panels: `tokens.css` has every colour, typeface, size and spacing.

A style sheet elsewhere names these tokens and holds no colour or typeface of its own.
"""

import functools
from pathlib import Path

TOKENS = Path(__file__).with_name("tokens.css")


@functools.cache
def tokens_css() -> str:
    """The text of `tokens.css`, which belongs before the style sheet of each page."""
    return TOKENS.read_text(encoding="utf-8")
