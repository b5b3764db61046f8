"""The one design system of all pages and panels: `tokens.css` has every colour, typeface, size and spacing.

A style sheet elsewhere names these tokens and holds no colour or typeface of its own. So does an SVG template; it is
given their values, because an SVG is a file of its own. Colours of data (rows of a report, scores) are beside the data.
"""

import functools
import re
from pathlib import Path

TOKENS = Path(__file__).with_name("tokens.css")


@functools.cache
def tokens_css() -> str:
    """The text of `tokens.css`, which belongs before the style sheet of each page."""
    return TOKENS.read_text(encoding="utf-8")


@functools.cache
def light_token(name: str) -> str:
    """The value of a token, such as `ink` or `font`, on a white page."""
    found = re.search(rf"--personal-{name}: ([^;]+);", tokens_css())
    assert found is not None, name
    return found[1]
