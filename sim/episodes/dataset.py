"""Opens a folder of PersONAL episode files and iterates over it; all other code gets its episodes here."""

import hashlib
import re
import zlib
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

from pydantic import FailFast, ValidationError

from sim.errors import DatasetError, did_you_mean, line_from_validation_error, short
from sim.files import bounded_json
from sim.types import SPLITS, EpisodeKey, Split

from .schema import NAME_PATTERN, Episode, EpisodeRecord, Goal, SceneFile, resolve_episode

_ADVICE = '"personal-viz validate" lists every problem.'
MOST_OBJECTS = 50_000
"""Most objects of a content file, eight times the largest released one."""
MANY_OBJECTS = 15_000
"""A content file with more objects (three times the largest released one) has only its first problems listed."""


class _AtOnce(SceneFile):
    """A content file that is refused at its first bad episode or goal, because each problem takes half a kilobyte."""

    goals_by_category: dict[str, Annotated[tuple[Goal, ...], FailFast()]]
    episodes: Annotated[tuple[EpisodeRecord, ...], FailFast()]


class PersonalDataset:
    """Episode files below one folder, read on demand and kept.

    Layout: `<root>/<split>/content/<SceneName>.json.gz` (or plain `.json`; where both exist the `.gz` counts).
    """

    def __init__(self, root: Path | str, *, evidence: Sequence[Path | str] = ()) -> None:
        """Lists the files without reading them.

        Args:
            root: The folder of the episodes.
            evidence: Folders of further editions of the dataset. Their places and objects help to recover homes that
                have no scan; none of their episodes is among this dataset's.

        Raises:
            DatasetError: A folder does not exist or holds no content file, or an edition of the evidence is named
                twice or holds none of the scenes.
        """
        self.root = Path(root)
        self.files: dict[tuple[Split, str], Path] = {}
        for split in SPLITS:
            for path in sorted((self.root / split / "content").glob("*.json")):
                self.files[(split, path.name.removesuffix(".json"))] = path
            for path in sorted((self.root / split / "content").glob("*.json.gz")):
                self.files[(split, path.name.removesuffix(".json.gz"))] = path
        if not self.files:
            raise DatasetError(
                f"{self.root}: found no episode file; expected {self.root}/easy|medium|hard/content/<Scene>.json.gz. "
                "Give the folder that holds the splits (data/split in the authors' repository)."
            )
        self._contents: dict[tuple[Split, str], SceneFile] = {}
        self.evidence = tuple(PersonalDataset(other) for other in evidence)
        """Further editions that help to recover homes, in the order in which their facts count."""
        _require_other_editions(self)

    @property
    def scenes(self) -> tuple[str, ...]:
        """Names of all scenes, sorted."""
        return tuple(sorted({scene for _, scene in self.files}))

    def content(self, split: Split, scene: str) -> SceneFile:
        """One content file, checked against the schema.

        Raises:
            DatasetError: The scene is not in this split, its name is not valid, or its file is damaged or not in the
                format.
        """
        key = (split, scene)
        if key not in self.files:
            known = [name for of_split, name in self.files if of_split == split]
            raise DatasetError(
                f"{self.root}: scene {scene!r} is not in split {split!r}; expected one of: "
                f"{', '.join(known) or 'no scene'}.{did_you_mean(scene, known)}"
            )
        if not re.fullmatch(NAME_PATTERN, scene):
            raise DatasetError(
                f"{self.files[key]}: the scene's name is {short(scene, most=80)}; expected 1-64 letters, digits, _ or "
                "-. Rename the file to <SceneName>.json.gz."
            )
        if key not in self._contents:
            self._contents[key] = read_scene_file(self.files[key])
        return self._contents[key]

    def episodes(
        self, *, splits: tuple[Split, ...] = SPLITS, scenes: tuple[str, ...] | None = None
    ) -> Iterator[Episode]:
        """All episodes with their targets, ordered by split (easy, medium, hard), scene name and place in the file.

        Raises:
            DatasetError: A named scene is unknown, a file is damaged or uses an episode id twice, or a target does not
                resolve.
        """
        for scene in scenes or ():
            self.require_scene(scene)
        for split in splits:
            for of_split, scene in sorted(self.files):
                if of_split != split or (scenes is not None and scene not in scenes):
                    continue
                content = self.content(split, scene)
                _require_distinct_ids(self.files[(split, scene)], content)
                for index, record in enumerate(content.episodes):
                    try:
                        yield resolve_episode(split, scene, record, content)
                    except KeyError as error:
                        where = f"{self.files[(split, scene)]}: episodes[{index}]"
                        raise DatasetError(f"{where}: {error.args[0]}. {_ADVICE}") from None

    def sample(
        self,
        *,
        splits: tuple[Split, ...] = SPLITS,
        scenes: tuple[str, ...] | None = None,
        per_split: int | None = None,
        seed: int = 0,
    ) -> list[Episode]:
        """Episodes in the dataset's order: at most `per_split` of each split, drawn as in `sample_keys`; None = all.

        Raises:
            DatasetError: As `episodes`.
        """
        found = list(self.episodes(splits=tuple(dict.fromkeys(splits)), scenes=scenes))
        drawn = set(sample_keys([episode.key for episode in found], per_split=per_split, seed=seed))
        return [episode for episode in found if episode.key in drawn]

    def episode(self, key: EpisodeKey | str) -> Episode:
        """One episode, by its key or by its name as a person types it, such as "easy/TEEsavR23oF/240".

        Raises:
            DatasetError: There is no such episode, or the text is not a key.
        """
        key = key_from_text(key) if isinstance(key, str) else key
        keys: list[EpisodeKey] = []
        for episode in self.episodes(splits=(key.split,), scenes=(key.scene,)):
            if episode.key == key:
                return episode
            keys.append(episode.key)
        raise DatasetError(
            f"{self.root}: found no episode {key}; expected an id of {key.split}/{key.scene}.{did_you_mean(key, keys)}"
        )

    def goals(self, scene: str) -> dict[str, Goal]:
        """Every goal object of a scene by `object_name`, from all splits; the first split with the object counts."""
        self.require_scene(scene)
        found: dict[str, Goal] = {}
        for split in SPLITS:
            if (split, scene) in self.files:
                for goals in self.content(split, scene).goals_by_category.values():
                    for goal in goals:
                        found.setdefault(goal.object_name, goal)
        return found

    def require_scene(self, scene: str) -> None:
        """Raises DatasetError when no split has the scene."""
        if scene not in self.scenes:
            raise DatasetError(
                f"{self.root}: found no scene {scene!r}; expected one of: {', '.join(self.scenes)}."
                f"{did_you_mean(scene, self.scenes)}"
            )

    def digest(self) -> str:
        """sha256 over the decompressed bytes of all content files, in order of split and scene, and over the digests of
        the evidence: homes recovered with other evidence are other homes."""
        total = hashlib.sha256()
        for (split, scene), path in sorted(self.files.items()):
            total.update(f"{split}/{scene}\n".encode())
            total.update(read_bytes(path))
        for edition in self.evidence:
            total.update(f"evidence {edition.digest()}\n".encode())
        return total.hexdigest()

    def scene_digest(self, scene: str, *, splits: tuple[Split, ...] = SPLITS) -> str:
        """sha256 over the decompressed bytes of one scene's files in these splits, without the evidence."""
        total = hashlib.sha256()
        for split in splits:
            if (split, scene) in self.files:
                total.update(f"{split}\n".encode() + read_bytes(self.files[split, scene]))
        return total.hexdigest()


def key_from_text(text: str, *, where: str = "episode") -> EpisodeKey:
    """The key that `SPLIT/SCENE/ID` names, as a person types it; `where` names the option or field in the error.

    Raises:
        DatasetError: The text is something else.
    """
    split, scene, episode_id = (*text.strip().split("/"), "", "", "")[:3]
    if text.count("/") != 2 or split not in SPLITS or not (scene and episode_id):
        raise DatasetError(
            f"{where}: found {text!r}; expected SPLIT/SCENE/ID, SPLIT one of {', '.join(SPLITS)}."
            f"{'' if split in SPLITS else did_you_mean(split, SPLITS)}"
        )
    return EpisodeKey(split, scene, episode_id)


def sample_keys(keys: Sequence[EpisodeKey], *, per_split: int | None, seed: int) -> list[EpisodeKey]:
    """At most `per_split` episodes of each split, spread evenly over its scenes, in the given order; None = all.

    The seeded order of a scene's episodes depends on nothing else, so a larger sample contains every smaller one with
    the same seed (a run can be made longer), and other splits and scenes change nothing.
    """
    if per_split is None:
        return list(keys)

    def place(text: str) -> bytes:
        return hashlib.sha256(f"{seed} {text}".encode()).digest()

    by_scene: dict[tuple[Split, str], list[EpisodeKey]] = defaultdict(list)
    for key in sorted(keys, key=lambda key: place(str(key))):
        by_scene[key.split, key.scene].append(key)
    drawn: set[EpisodeKey] = set()
    for split in {split for split, _ in by_scene}:
        scenes = [(place(scene), found) for (of, scene), found in by_scene.items() if of == split]
        turns = [(turn, order, key) for order, found in scenes for turn, key in enumerate(found)]
        drawn |= {key for _, _, key in sorted(turns)[:per_split]}
    return [key for key in keys if key in drawn]


def _require_other_editions(dataset: PersonalDataset) -> None:
    """Raises DatasetError when evidence is the dataset itself, is named twice, or shares no scene with the dataset."""
    seen = {dataset.root.resolve(): "the dataset itself"}
    for edition in dataset.evidence:
        folder = edition.root.resolve()
        if folder in seen:
            raise DatasetError(f"evidence {edition.root}: is {seen[folder]}; expected another edition. Leave it out.")
        seen[folder] = "named twice"
        if not set(dataset.scenes) & set(edition.scenes):
            raise DatasetError(
                f"evidence {edition.root}: holds none of the scenes of {dataset.root}; expected another edition of the "
                "same homes. Give its folder, or leave it out."
            )


def _require_distinct_ids(path: Path, content: SceneFile) -> None:
    """Raises DatasetError when two episodes of a file have the same id: their runs could not be told apart."""
    for index, other in repeated_ids(content):
        raise DatasetError(
            f"{path}: episodes[{index}].episode_id is {content.episodes[index].episode_id!r}, as in episodes[{other}]; "
            f"expected one use per file. {_ADVICE}"
        )


def repeated_ids(content: SceneFile) -> Iterator[tuple[int, int]]:
    """Index of each episode whose id an earlier one has, and of the first episode with this id."""
    first_place: dict[str, int] = {}
    for index, record in enumerate(content.episodes):
        if first_place.setdefault(record.episode_id, index) != index:
            yield index, first_place[record.episode_id]


def read_bytes(path: Path) -> bytes:
    """The file's bytes, decompressed when its name ends in .gz.

    Raises:
        DatasetError: The file cannot be read, is not valid gzip, or is larger than any real content file.
    """
    try:
        return bounded_json(path)
    except (OSError, EOFError, zlib.error) as error:
        raise DatasetError(
            f"{path}: found a file that cannot be read ({error}); expected gzip-compressed JSON. "
            "Copy the file again from its source."
        ) from None


def content_text(path: Path) -> tuple[bytes, int]:
    """The JSON text of a content file, and the number of its objects.

    Raises:
        DatasetError: The file is unreadable, or has more objects than any home.
    """
    text = read_bytes(path)
    num_objects = text.count(b"{")
    if num_objects > MOST_OBJECTS:
        raise DatasetError(
            f"{path}: found {num_objects} JSON objects; expected at most {MOST_OBJECTS}. Give a file per scene."
        )
    return text, num_objects


def read_scene_file(path: Path) -> SceneFile:
    """Reads and checks one content file.

    Raises:
        DatasetError: The file is unreadable, not JSON, or not in the format.
    """
    text, num_objects = content_text(path)
    try:
        if num_objects <= MANY_OBJECTS:
            return SceneFile.model_validate_json(text, strict=True)
        return SceneFile.model_construct(**dict(_AtOnce.model_validate_json(text, strict=True)))
    except ValidationError as error:
        raise DatasetError(line_from_validation_error(path, error, advice=_ADVICE)) from None
