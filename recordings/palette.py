"""Colours of runs; light, so that apps without Rerun use the same."""

Rgb = tuple[int, int, int]
RUN_COLORS: tuple[Rgb, ...] = (
    (86, 180, 233),
    (230, 159, 0),
    (0, 158, 115),
    (204, 121, 167),
    (240, 228, 66),
    (213, 94, 0),
    (0, 114, 178),
    (150, 90, 220),
)
"""Okabe and Ito's palette, which colour-blind people can tell apart, and a violet; more runs begin it again."""
