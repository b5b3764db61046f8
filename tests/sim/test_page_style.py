"""Colours of the design system can be read, and no other style sheet has colours or typefaces of its own."""

import re
from pathlib import Path

import pytest

from sim.page_style import light_token, tokens_css

ROOT = Path(__file__).resolve().parents[2]
TEXTS = ("ink", "quiet", "link", "good", "bad", "warn")
SURFACES = ("paper", "ground", "head", "soft", "warn-soft", "good-soft", "mark")
FILLS = ("blue", "blue-dark", "red", "red-dark", "green", "green-dark", "gray", "gray-dark", "night")
OTHERS = {"on-fill", "line", "edge", "focus", "track", "done", "held", "free", "failed", "shade", "veil", "clear"}
LITERAL = re.compile(
    r"#[0-9a-fA-F]{3,8}\b|\b(?:rgba?|hsla?|oklch)\(|font-family:(?!\s*(?:inherit|var\())|font:[^;}]*sans|monospace"
    r"|font-family=(?!\"{{)"
)
STYLED = ("*.css", "*.html", "*.html.j2", "page.js", "forms.js", "enter.js", "updated.js", "dashboard.js")
PACKAGES = ("sim", "human_study", "personal_viz")


def tokens(scheme: str) -> dict[str, str]:
    """Values of the colour tokens by name, in the `light` or `dark` scheme."""
    light, _, dark = tokens_css().partition("@media")
    found = dict(re.findall(r"--personal-([\w-]+): (#[0-9a-f]{6}|rgba\([^)]*\));?", light))
    return found if scheme == "light" else found | dict(re.findall(r"--personal-([\w-]+): (#[0-9a-f]{6});", dark))


def luminance(colour: str) -> float:
    """Relative luminance of `#rrggbb`, by WCAG 2.2."""
    parts = [int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)]
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(one: str, other: str) -> float:
    """Contrast of two colours, 1 to 21, by WCAG 2.2."""
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_contrast_of_known_pairs() -> None:
    assert contrast("#000000", "#ffffff") == pytest.approx(21)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.01)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_text_is_readable_on_every_surface_and_fill(scheme: str) -> None:
    value = tokens(scheme)
    pairs = [(text, surface) for text in TEXTS for surface in SURFACES] + [("on-fill", fill) for fill in FILLS]
    faint = {pair: round(contrast(value[pair[0]], value[pair[1]]), 2) for pair in pairs}
    assert {pair: ratio for pair, ratio in faint.items() if ratio < 4.5} == {}


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_edges_of_buttons_and_the_focus_are_seen_on_every_surface(scheme: str) -> None:
    value = tokens(scheme)
    low = {(line, surface): contrast(value[line], value[surface]) for line in ("edge", "focus") for surface in SURFACES}
    assert {pair: round(ratio, 2) for pair, ratio in low.items() if ratio < 3} == {}


def test_every_colour_of_the_design_system_is_one_of_the_tested_kinds() -> None:
    assert set(tokens("light")) == {*TEXTS, *SURFACES, *FILLS, *OTHERS}


def test_two_typefaces_and_buttons_of_32_pixels() -> None:
    assert len(re.findall(r"sans-serif|monospace;", tokens_css())) == 2
    assert "--personal-button: 32px" in tokens_css()


def test_no_other_style_sheet_has_a_colour_or_a_typeface() -> None:
    files = [path for pattern in STYLED for path in (ROOT / "personal_viz").rglob(pattern)]
    files += [ROOT / "human_study/report/page.py", ROOT / "personal_viz/annotate/panels.py"]
    files += [path for package in PACKAGES for path in (ROOT / package).rglob("*.svg.j2")]
    found = {
        f"{path.relative_to(ROOT)}:{number}": line.strip()
        for path in files
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if LITERAL.search(line.replace("&#", ""))
    }
    assert len(files) > 20
    assert found == {}


def test_a_drawing_has_the_values_of_tokens() -> None:
    assert light_token("ink") == tokens("light")["ink"]
    assert light_token("font").endswith("sans-serif")
    with pytest.raises(AssertionError, match="no such token"):
        light_token("no such token")


def test_every_token_that_a_style_sheet_names_exists() -> None:
    known = set(re.findall(r"--personal-([\w-]+):", tokens_css()))
    texts = [path.read_text(encoding="utf-8") for pattern in STYLED for path in (ROOT / "personal_viz").rglob(pattern)]
    texts += [(ROOT / "human_study/report/page.py").read_text(encoding="utf-8")]
    assert set(re.findall(r"var\(--personal-([\w-]+)", "\n".join(texts))) <= known
