"""Writes the page of a whole study or benchmark: run folders -> a row per episode with its recording and contact sheet.

Run folders -> trials in figures (gathered.py) -> folders of episodes, made in worker processes
(episode_folder.py) -> `index.html` and `index.md`.
"""

import tempfile
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import RunFileError
from sim.files import write_whole
from sim.homes.kind import scene_kind
from sim.homes.open_home import find_scan
from sim.tasks.workers import results
from sim.types import EpisodeKey

from . import PICTURE_WIDTH
from .episode_folder import FoldersJob, cannot_write, folder_name, inputs_digest, is_made, open_home
from .gathered import Gathered, Setting, Trial, gather
from .page import Page, page_html, page_markdown
from .rows import sections

EPISODES = "episodes"
"""Folder of the episodes' folders."""


@dataclass(frozen=True, slots=True)
class Written:
    """Figures of a finished comparison."""

    page: Path
    num_episodes: int
    num_made: int
    """Number of episodes made now; the folders of the others were up to date."""
    num_runs: int
    has_left_out_pixels: bool
    """Whether geometry and pictures of scans were left out."""


@dataclass(frozen=True, slots=True)
class _Home:
    """The trials in one home in one setting."""

    setting: Setting
    scene: str
    scenes_dir: Path | None
    """Folder of scans; None = a plan, or else a schematic home."""
    suffix: str
    """End of the names of its episodes' folders; tells them from those of other settings."""
    trials: Mapping[EpisodeKey, Sequence[Trial]]


def write_comparison(
    folders: Sequence[Path],
    *,
    dataset: Path,
    out: Path,
    evidence: tuple[Path, ...] = (),
    scenes_dir: Path | None = None,
    with_pixels: bool = False,
    picture_width: int = PICTURE_WIDTH,
    jobs: int = 1,
    on_plan: Callable[[int], None] = lambda left: None,
    on_episode: Callable[[], None] = lambda: None,
) -> Written:
    """Writes the page of all runs and what it links to; keeps what an earlier call made from the same inputs.

    Args:
        folders: Run folders, or folders of run folders.
        dataset: Folder of the episodes.
        out: Folder for `index.html`, `index.md` and `episodes/`.
        evidence: Folders of the dataset's evidence.
        scenes_dir: Folder of the scans; None = invented or schematic homes.
        with_pixels: Write maps, geometry and pictures of scans too (their terms of use hold for the folder).
        picture_width: Width of the robots' pictures in recordings; 0 leaves them out.
        jobs: Worker processes, one home each.
        on_plan: Told how many episodes are to be made.
        on_episode: Called after each of them.

    Raises:
        RunFileError: Runs are damaged, never scored, or cannot be compared.
        RecordingError: A home is another version than that of the runs, or the folder cannot be written.
        PersonalVizError: A home cannot be opened, or a worker process was ended from outside.
    """
    episodes = PersonalDataset(dataset, evidence=evidence)
    digest = episodes.digest()
    known = {episode.key: episode for episode in episodes.episodes()}
    with tempfile.TemporaryDirectory(prefix="personal-compare-") as aside:
        gathered = gather(folders, dataset_digest=digest, episodes=known, into=Path(aside))
        homes = _homes(gathered.trials, episodes, scenes_dir)
        page = _page(gathered, homes, known, has_scan_pixels=with_pixels)  # refuses before hours of work
        work = _folder_jobs(
            homes,
            folders,
            dataset=episodes,
            dataset_digest=digest,
            runs=Path(aside),
            out=out / EPISODES,
            with_pixels=with_pixels,
            picture_width=picture_width,
        )
        num_left = sum(len(job.keys) for job in work)
        on_plan(num_left)
        for _ in results(open_home, work, processes=min(jobs, len(work)), batch=max(1, num_left)):
            on_episode()
    try:
        write_whole(out / "index.html", page_html(page))
        write_whole(out / "index.md", page_markdown(page))
    except OSError as error:
        raise cannot_write(out, error) from None
    num_episodes = sum(len(home.trials) for home in homes)
    return Written(out / "index.html", num_episodes, num_left, len(gathered.runs), page.has_left_out_pixels)


def _folder_jobs(
    homes: Sequence[_Home],
    folders: Sequence[Path],
    *,
    dataset: PersonalDataset,
    dataset_digest: str,
    runs: Path,
    out: Path,
    with_pixels: bool,
    picture_width: int,
) -> list[FoldersJob]:
    """A job for each home: the episodes whose folder is missing, incomplete or made from other inputs."""
    given = [folder.resolve() for folder in folders]
    options = {"dataset": dataset_digest, "with_pixels": with_pixels, "picture_width": picture_width}
    work = []
    for home in homes:
        inputs = _inputs(home, dataset.root, options)
        names = {key: folder_name(key, home.suffix) for key in inputs}
        versions = [trial.scene_digest for trials in home.trials.values() for trial in trials if trial.scene_digest]
        work.append(
            FoldersJob(
                dataset.root,
                home.scene,
                tuple(key for key in inputs if not is_made(out / names[key], inputs[key])),
                setting=home.setting,
                scenes_dir=home.scenes_dir,
                runs=runs,
                scene_digest=versions[0] if versions else None,
                out=out,
                suffix=home.suffix,
                inputs=inputs,
                with_pixels=with_pixels,
                picture_width=picture_width,
                beside=tuple(dict.fromkeys([*given, *(folder.parent for folder in given)])),
                evidence=tuple(edition.root for edition in dataset.evidence),
            )
        )
    return work


def _homes(trials: Sequence[Trial], dataset: PersonalDataset, scenes_dir: Path | None) -> list[_Home]:
    """Every home with its trials, by setting and name; answers on oracle maps join other runs of the episode."""
    by_home: dict[tuple[Setting, str], dict[EpisodeKey, list[Trial]]] = defaultdict(lambda: defaultdict(list))
    for trial in trials:
        if trial.setting is not None:
            by_home[trial.setting, trial.key.scene][trial.key].append(trial)
    for trial in trials:
        if trial.setting is None:
            own = Setting(scene_kind(dataset, trial.key.scene, scenes_dir))
            holders = [setting for setting, scene in sorted(by_home) if trial.key in by_home[setting, scene]]
            for setting in dict.fromkeys(holders) if holders else [own]:
                by_home[setting, trial.key.scene][trial.key].append(trial)
    return [
        _Home(setting, scene, *_source(dataset, setting, scene, scenes_dir, members), members)
        for (setting, scene), members in sorted(by_home.items())
    ]


def _source(
    dataset: PersonalDataset,
    setting: Setting,
    scene: str,
    scenes_dir: Path | None,
    trials: Mapping[EpisodeKey, Sequence[Trial]],
) -> tuple[Path | None, str]:
    """`_Home.scenes_dir` and `_Home.suffix` of a home."""
    level = (f"-clutter{setting.clutter}" if setting.clutter else "") + ("-labels" if setting.labels else "")
    if scene_kind(dataset, scene, scenes_dir) == setting.kind:
        return scenes_dir, level
    if scene_kind(dataset, scene, None) == setting.kind:
        return None, f"-{setting.kind}{level}"
    run_id = next(iter(trials.values()))[0].run_id
    found = scene_kind(dataset, scene, scenes_dir)
    advice = "Give --scenes-dir" if setting.kind == "scan" else "Give the --dataset of the run"
    raise RunFileError(
        f"{run_id}: was made on a home of kind {setting.kind!r}, {scene} can only be opened as "
        f"{found!r} here; expected the kind of the run. {advice}, or leave the run out."
    )


def _page(
    gathered: Gathered, homes: Sequence[_Home], known: Mapping[EpisodeKey, Episode], *, has_scan_pixels: bool
) -> Page:
    folders: dict[tuple[Setting | None, EpisodeKey], str] = {}
    for home in homes:
        for key in home.trials:
            folders[home.setting, key] = f"{EPISODES}/{folder_name(key, home.suffix)}"
            folders.setdefault((None, key), folders[home.setting, key])
    queries = {key: known[key].record.query[0] for _, key in folders}
    is_scan = any(home.setting.kind == "scan" for home in homes)
    return Page(
        tuple(sections(gathered.trials, gathered.runs, queries=queries, folders=folders)),
        edition=gathered.runs[0].info.edition,
        has_scan_pixels=is_scan and has_scan_pixels,
        has_left_out_pixels=is_scan and not has_scan_pixels,
    )


def _inputs(home: _Home, dataset: Path, options: Mapping[str, object]) -> dict[EpisodeKey, str]:
    """Digest of what each episode's folder is made from; the home's files are told by size and time, unread."""
    plan = dataset / "scenes" / f"{home.scene}.plan.json"
    files = [plan] if plan.is_file() else []
    if home.scenes_dir is not None and home.setting.kind == "scan":
        scan = find_scan(home.scene, home.scenes_dir)
        files += sorted(path for path in scan.resolve().parent.glob(f"{home.scene}.*") if path.is_file())
    stats = [(str(path), path.stat()) for path in files]
    source = home.setting, *((name, stat.st_size, stat.st_mtime_ns) for name, stat in stats)
    return {
        key: inputs_digest({**options, "home": source, "runs": tuple(trial.digest for trial in trials)})
        for key, trials in home.trials.items()
    }
