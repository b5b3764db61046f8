"""Worker of `personal-viz export`: runs in other formats."""

from pathlib import Path

from sim.errors import PersonalVizError
from sim.exchange.export_runs import ExportFormat, export_runs
from sim.tasks.metrics import read_runs
from sim.tasks.run_files import Run


def export(*, runs: tuple[Path, ...], out: Path, format: ExportFormat = "jsonl") -> int:
    """Writes runs in another format, prints where.

    Args:
        runs: Run folders, folders of those, or recordings (.rrd) of ours.
        out: Folder that gets one folder per run.
        format: `jsonl`, `tum` or `minari`.

    Returns:
        0; problems are raised as one-line errors.
    """
    for written in export_runs(_read(runs), format=format, out=out):
        answers = f", {written.num_answers} answers" if written.num_answers else ""
        left = f" {written.num_left_out} POG answers left out: {format} has no place for them."
        print(f"{written.folder}: {written.num_episodes} episodes{answers}.{left if written.num_left_out else ''}")
        if format == "minari":
            name = written.folder.relative_to(out).as_posix()
            print(f'MINARI_DATASETS_PATH={out.resolve()} python -c "import minari; minari.load_dataset({name!r})"')
    return 0


def _read(paths: tuple[Path, ...]) -> list[Run]:
    """The runs of folders and recordings, in the order given."""
    if not paths:
        raise PersonalVizError("export: found no run; expected run folders or .rrd files. Give at least one.")
    found: list[Run] = []
    for path in paths:
        if path.suffix.lower() == ".rrd":
            from recordings.read import read_rrd

            found += read_rrd(path)
        else:
            found += read_runs([path])
    return found
