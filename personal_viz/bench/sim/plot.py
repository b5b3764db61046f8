"""Draws the simulator benchmark's picture: time per frame over triangles, for our renderer, its bound and Open3D."""

import io

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..harness import Report, Values

_LINES = (
    ("open3d_rays_ms", "Open3D, rays only", "#b5472f", "s", True),
    ("rgbd_ms", "ours: RGB (bilinear) + depth + ids", "#1f5fa8", "o", True),
    ("depth_ms", "ours: depth only", "#3d9a5f", "^", True),
    ("raw_ms", "raw Embree, rays only (bound)", "#555555", "D", False),
)
"""Figure, legend, colour, marker, and whether numbers stand above, for each line."""
_TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


def frame_time_png(report: Report) -> bytes:
    """A PNG picture of core-ms per frame over triangles, both axes logarithmic; plain scenes left, cluttered right."""
    figure = Figure(figsize=(10.5, 5.6), dpi=120, layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, cluttered in zip(panels, (False, True), strict=True):
        chosen = [figures for figures in report.values["sizes"].values() if figures["cluttered"] == cluttered]
        for name, label, colour, marker, above in _LINES:
            _draw(axes, chosen, name, label=label, look=(colour, marker), above=above)
        axes.set_title("cluttered house" if cluttered else "furnished house", fontsize=10)
        axes.set_xlabel("triangles")
        axes.grid(alpha=0.3)
    _scale(panels[0], report)
    panels[0].set_ylabel("core-ms per frame of 640 x 480 (median)")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    machine, kind = report.machine, "quick run" if report.quick else "full run"
    renderer = machine.versions["renderer"]
    figure.suptitle(f"{machine.cpu}, one thread, {renderer}, {report.created_utc[:10]}, {kind}", fontsize=11)
    file = io.BytesIO()
    figure.savefig(file, format="png")
    return file.getvalue()


def _scale(axes: Axes, report: Report) -> None:
    """Sets logarithmic axes with round numbers, shared by both panels."""
    faces = sorted({float(f"{f['faces']:.2g}") for f in report.values["sizes"].values()})
    values = [value for f in report.values["sizes"].values() for line in _LINES if (value := f[line[0]]) is not None]
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(faces[0] / 1.5, faces[-1] * 1.5)
    axes.set_xticks(faces, [_short(count) for count in faces])
    axes.set_xticks([], minor=True)
    axes.set_yticks(_TICKS, [str(tick) for tick in _TICKS])
    axes.set_yticks([], minor=True)
    axes.set_ylim(min(values) / 1.4, max(values) * 1.4)  # after the ticks, which widen it


def _draw(axes: Axes, chosen: list[Values], name: str, *, label: str, look: tuple[str, str], above: bool) -> None:
    """Draws one line with the value at each point; skips points where the figure was not measured."""
    points = [(figures["faces"], value) for figures in chosen if (value := figures[name]) is not None]
    if not points:
        return
    colour, marker = look
    x, y = zip(*points, strict=True)
    axes.plot(x, y, marker=marker, markersize=5, color=colour, label=label)
    for faces, value in points:
        axes.annotate(
            f"{value:.3g}",
            (faces, value),
            xytext=(0, 7 if above else -14),
            textcoords="offset points",
            ha="center",
            fontsize=8,
            color=colour,
        )


def _short(count: float) -> str:
    return f"{count / 1e6:g}M" if count >= 1e6 else f"{count / 1e3:g}k"
