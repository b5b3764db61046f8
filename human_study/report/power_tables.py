"""A power report as Markdown."""

from .blocks import Block, Heading, Table, Text, markdown_text
from .power import PowerReport, PowerRow

_HEADS = (
    *("design", "people", "episodes per split", "people per episode", "trials each", "trials"),
    *("width of a split (points)", "width of the total", "splits apart", "people and agent apart", "memory"),
)


def power_markdown(report: PowerReport) -> str:
    """Tables by spread of people, and what they say."""
    told = report.assumptions
    blocks: list[Block] = [
        Heading("Precision and power", 1),
        Text(
            f"{told.num_simulations} simulated studies per number (seed {told.seed}); people succeed at "
            f"{100 * told.base_rate:g} %, splits differ by {100 * told.split_gap:g} points, the agent is "
            f"{100 * told.agent_gap:g} points worse, memory helps by {100 * told.memory_gap:g} points. People and "
            f"episodes vary on the logit scale, episodes with s.d. {told.episode_sd:g}. Widths are full widths of the "
            "report's own 95 % intervals; the other columns are the share of studies that find the difference. "
            f"Planning figures, not findings: a share of 0.5 is known to +-{1 / told.num_simulations**0.5:.2f}."
        ),
    ]
    for spread in told.person_sds:
        rows = [row for row in report.rows if row.person_sd == spread]
        blocks += [Heading(f"People differ with s.d. {spread:g}"), Table(_HEADS, tuple(_line(row) for row in rows))]
    return markdown_text([*blocks, Text(_advice(report), is_strong=True)])


def _line(row: PowerRow) -> tuple[str, ...]:
    return (
        *(row.design, str(row.num_people), str(row.episodes_per_split), str(row.raters_per_episode)),
        *(f"{row.trials_per_person:g}", str(row.trials), f"{row.width_split:.1f}", f"{row.width_total:.1f}"),
        *(f"{row.power_splits:.2f}", f"{row.power_agent:.2f}"),
        "-" if row.power_memory is None else f"{row.power_memory:.2f}",
    )


def _advice(report: PowerReport) -> str:
    """The design of as many trials with the narrowest total where people differ most."""
    widest = max(report.assumptions.person_sds)
    rows = [row for row in report.rows if row.person_sd == widest]
    alike = [row for row in rows if row.trials <= 1.05 * rows[0].trials]
    best = min(alike, key=lambda row: row.width_total)
    if best is rows[0]:
        return "Of these designs with as many trials, none is more precise where people differ: keep this one."
    return (
        f"Where people differ (s.d. {widest:g}), '{best.design}' gives a total {best.width_total:.1f} points wide for "
        f"as many trials, this design {rows[0].width_total:.1f}: spend trials on more people and on more episodes."
    )
