"""The simulator benchmark's figures: as values that go to JSON, beside their targets, and as a Markdown table."""

import math
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from .copies import BrowserFigures
from .loading import LoadFigures
from .rendering import RenderFigures
from .walking import NavigationFigures

MAIN_FACES = 1_000_000
"""Most targets of SIM.md section 5 are for this many triangles."""
GROWING = ("raw_ms", "depth_ms", "rgbd_ms", "open3d_rays_ms", "tree_s", "build_s", "field_ms", "path_us", "load_s")
"""Figures whose growth with the number of triangles is fitted."""


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Machine(_Model):
    """What the figures depend on besides the code."""

    cpu: str
    cores: int
    """Processors that this process may use."""
    backend: str
    """What finds the hits: embree or open3d."""
    packet_width: int
    """Rays per packet; 1 = single rays."""
    backend_reason: str
    """Why this backend and width were taken."""
    python: str
    versions: dict[str, str]
    """Of the packages that figures may depend on."""


class SizeFigures(RenderFigures, NavigationFigures):
    """All figures of one scene."""

    faces: int
    cluttered: bool
    rgbd_over_raw: float | None
    depth_over_raw: float | None
    open3d_over_rgbd: float
    load_over_trimesh: float | None
    """CPU time to the first frame over trimesh's with its textures decoded; None where loading was left out."""
    load_over_trimesh_undecoded: float | None
    """The same over trimesh's `load_scene` alone, which leaves JPEG textures undecoded."""
    load_wall_over_trimesh: float | None
    """As `load_over_trimesh`, elapsed time."""
    rss_mb: float | None
    """Resident memory of a process that loaded the scene and rendered a frame, all of it."""
    env_steps_per_s: float
    """PanEnv with pictures, one thread, elapsed time."""
    env_steps_per_s_without_rendering: float
    load: LoadFigures | None
    trimesh: LoadFigures | None

    @property
    def load_s(self) -> float | None:
        """CPU seconds from file to first frame."""
        return self.load and self.load.core_s


class Target(_Model):
    """One line of SIM.md section 5 (or of the issue) and what was measured."""

    name: str
    wanted: str
    limit: float
    sense: Literal["at most", "at least"]
    value: float | None
    """None = not measured in this run."""
    met: bool | None


class SimReport(_Model):
    """`bench sim --json`."""

    benchmark: Literal["sim"] = "sim"
    quick: bool
    sizes: dict[str, SizeFigures]
    """By name: `100k`, `1M`, `1M cluttered`."""
    left_out: tuple[str, ...]
    """What a quick run does not measure."""
    browser: dict[str, BrowserFigures]
    """Browser copies by size name."""
    navmesh_path_us: float | None
    """CPU microseconds of one `shortest_path` on a Habitat .navmesh; None where none was given."""
    growth: dict[str, float | None]
    """Exponent e of figure ~ triangles^e, fitted over the plain sizes; None with fewer than two."""
    targets: tuple[Target, ...]
    machine: Machine
    notes: tuple[str, ...]
    created_utc: str
    git_commit: str | None
    seconds: float
    """Elapsed time of the whole run."""


def size_name(num_faces: int, cluttered: bool) -> str:
    """`100k`, `1M`, `1M cluttered`."""
    number = f"{num_faces / 1e6:g}M" if num_faces >= 1_000_000 else f"{num_faces / 1e3:g}k"
    return f"{number} cluttered" if cluttered else number


def targets(sizes: dict[str, SizeFigures], browser: dict[str, BrowserFigures]) -> tuple[Target, ...]:
    """Every speed target beside this run's figure, for the plain and the cluttered scene of MAIN_FACES."""
    plain, cluttered = sizes.get(size_name(MAIN_FACES, False)), sizes.get(size_name(MAIN_FACES, True))
    copy = browser.get(size_name(MAIN_FACES, False))
    return (
        _at_least("Open3D rays / ours (RGB-D)", 2.8, plain and plain.open3d_over_rgbd),
        _at_most("RGB-D / raw bound", 1.7, plain and plain.rgbd_over_raw, more=" (goal 1.5)"),
        _at_most("RGB-D / raw bound, cluttered", 3.5, cluttered and cluttered.rgbd_over_raw),
        _at_most("depth / raw bound", 1.15, plain and plain.depth_over_raw, more=" (goal 1.1)"),
        _at_most("load to first frame / trimesh", 1.0, plain and plain.load_over_trimesh),
        _at_most("resident memory, MB", 800.0, plain and plain.rss_mb),
        _at_most("navigation build, core-s", 0.5, plain and plain.build_s),
        _at_most("path, us", 50.0, plain and plain.path_us),
        _at_most("goal field, core-ms", 30.0, plain and plain.field_ms),
        _at_most("browser copy, triangles", 300_000.0, copy and copy.faces),
        _at_most("browser copy, MB", 15.0, copy and copy.megabytes),
        _at_most("browser copy, click error p99, mm", 20.0, copy and copy.click_p99_mm),
    )


def growth(sizes: Sequence[SizeFigures]) -> dict[str, float | None]:
    """Exponent of each figure of GROWING over the plain scenes' triangles."""
    plain = [figures for figures in sizes if not figures.cluttered]
    found: dict[str, float | None] = {}
    for name in GROWING:
        points = [(f.faces, value) for f in plain if (value := getattr(f, name)) is not None]
        if len({faces for faces, _ in points}) < 2:
            found[name] = None
            continue
        x, y = np.log(np.array(points, float)).T
        found[name] = float(np.polyfit(x, y, 1)[0])
    return found


def markdown(report: SimReport) -> str:
    """The report as Markdown: targets, figures per size, loading, browser copies, machine."""
    lines = [f"# Simulator benchmark{' (quick)' if report.quick else ''}", ""]
    lines += [f"{report.created_utc}, commit {report.git_commit or 'unknown'}, {report.seconds:.0f} s.", ""]
    lines += [f"- {line}" for line in machine_lines(report.machine)]
    lines += [f"- {note}" for note in report.notes]
    if report.left_out:
        lines += [f"- Left out of this quick run: {', '.join(report.left_out)}"]
    lines += ["", "## Targets (SIM.md section 5)", "", *_table(target_rows(report)), ""]
    lines += ["## Figures", "", *_table(figure_rows(report)), ""]
    if report.browser:
        rows = [
            [
                name,
                *(_number(value) for value in (f.build_s, f.faces, f.megabytes, f.click_median_mm, f.click_p99_mm)),
                f"{f.click_lost:.2%}",
            ]
            for name, f in report.browser.items()
        ]
        heads = [
            "Browser copy of",
            "build, core-s",
            "triangles",
            "MB",
            "click median, mm",
            "click p99, mm",
            "rays lost",
        ]
        lines += ["## Browser copies", "", *_table([heads, *rows]), ""]
    return "\n".join(lines)


def machine_lines(machine: Machine) -> list[str]:
    """Processor, backend and versions, for people."""
    versions = ", ".join(f"{name} {version}" for name, version in machine.versions.items())
    return [
        f"Machine: {machine.cpu}, {machine.cores} cores; Python {machine.python}, {versions}",
        f"Renderer: {machine.backend}, packets of {machine.packet_width}. {machine.backend_reason}",
    ]


def target_rows(report: SimReport) -> list[list[str]]:
    """The targets as a table, its heads first."""
    words = {True: "yes", False: "NO", None: "not measured"}
    rows = [[t.name, t.wanted, _number(t.value), words[t.met]] for t in report.targets]
    return [["Item", "Target", "Measured", "Met"], *rows]


def figure_rows(report: SimReport) -> list[list[str]]:
    """All figures as a table, its heads first: a column per size, and how each grows with the triangles."""
    kinds: list[tuple[str, str, Callable[[SizeFigures], float | None]]] = [
        ("triangles", "", lambda f: f.faces),
        ("raw Embree bound, core-ms", "raw_ms", lambda f: f.raw_ms),
        ("depth, core-ms", "depth_ms", lambda f: f.depth_ms),
        ("**RGB-D bilinear, core-ms**", "rgbd_ms", lambda f: f.rgbd_ms),
        ("RGB-D nearest, core-ms", "", lambda f: f.nearest_ms),
        ("RGB-D mipmap, core-ms", "", lambda f: f.mipmap_ms),
        ("RGB-D bilinear 256 x 256, core-ms", "", lambda f: f.rgbd_256_ms),
        ("Open3D rays only, core-ms", "open3d_rays_ms", lambda f: f.open3d_rays_ms),
        ("depth / raw", "", lambda f: f.depth_over_raw),
        ("RGB-D / raw", "", lambda f: f.rgbd_over_raw),
        ("Open3D / RGB-D", "", lambda f: f.open3d_over_rgbd),
        ("RGB-D wall ms, 1 thread", "", lambda f: f.wall.rgbd_1_ms),
        ("RGB-D wall ms, all threads", "", lambda f: f.wall.rgbd_ms),
        ("RGB-D wall ms, batch", "", lambda f: f.wall.batch_ms),
        ("Open3D rays wall ms, 1 thread", "", lambda f: f.wall.open3d_rays_1_ms),
        ("Open3D rays wall ms, all threads", "", lambda f: f.wall.open3d_rays_ms),
        ("search tree and tables, core-s", "tree_s", lambda f: f.tree_s),
        ("load to first frame, core-s", "load_s", lambda f: f.load_s),
        ("trimesh with textures decoded, core-s", "", lambda f: f.trimesh and f.trimesh.core_s),
        ("trimesh load_scene alone, core-s", "", lambda f: f.trimesh and f.trimesh.parse_core_s),
        ("load / trimesh", "", lambda f: f.load_over_trimesh),
        ("load / trimesh, elapsed", "", lambda f: f.load_wall_over_trimesh),
        ("resident, MB", "", lambda f: f.rss_mb),
        ("resident at most, MB", "", lambda f: f.load and f.load.peak_mb),
        ("trimesh resident, MB", "", lambda f: f.trimesh and f.trimesh.rss_mb),
        ("navigation build, core-s", "build_s", lambda f: f.build_s),
        ("goal field, core-ms", "field_ms", lambda f: f.field_ms),
        ("path, us", "path_us", lambda f: f.path_us),
        ("PanEnv steps/s", "", lambda f: f.env_steps_per_s),
        ("PanEnv steps/s without rendering", "", lambda f: f.env_steps_per_s_without_rendering),
    ]
    rows = [["", *report.sizes, "growth"]]
    for name, grows, figure in kinds:
        exponent = report.growth.get(grows)
        cells = [_number(figure(figures)) for figures in report.sizes.values()]
        rows.append([name, *cells, "" if exponent is None else f"n^{exponent:.2f}"])
    return rows


def _table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Markdown of rows whose first are the heads."""
    heads, *others = rows
    rule = "|".join(["---"] + ["---:"] * (len(heads) - 1))
    return [f"| {' | '.join(heads)} |", f"|{rule}|", *(f"| {' | '.join(row)} |" for row in others)]


def _number(value: float | None) -> str:
    """At most four significant digits, thousands grouped; `-` where there is none."""
    if value is None or not math.isfinite(value):
        return "-"
    if abs(value) >= 1000:
        return f"{value:,.0f}"
    return f"{value:.3g}"


def _at_most(name: str, limit: float, value: float | None, *, more: str = "") -> Target:
    met = None if value is None else value <= limit
    return Target(name=name, wanted=f"<= {_number(limit)}{more}", limit=limit, sense="at most", value=value, met=met)


def _at_least(name: str, limit: float, value: float | None) -> Target:
    met = None if value is None else value >= limit
    return Target(name=name, wanted=f">= {_number(limit)}", limit=limit, sense="at least", value=value, met=met)
