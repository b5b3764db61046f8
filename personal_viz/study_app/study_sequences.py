"""The home sequences of a study: those of its set, and those of practice, made in the practice home."""

from collections.abc import Sequence
from pathlib import Path

from human_study.design.plan import PRACTICE_FOLDER
from human_study.design.study import STUDY_FILE, StudyConfig
from sim.authoring.content import packed
from sim.episodes.schema import Episode
from sim.episodes.sequence_files import HomeSequence, SequenceSet, sequence_from_episode
from sim.episodes.sequences import SequenceRecord
from sim.errors import StudyError
from sim.files import write_whole
from sim.sequences.searches import sequence_key
from sim.types import EpisodeKey

PRACTICE_SET = f"{PRACTICE_FOLDER}/sequences"
"""Set of the practice home's sequences, in the folder of a study or of its export."""
_IN_VIEW = "view-"
"""Beginning of the names of sequences for attention trials."""
PRACTICE_SEQUENCES = 3
"""Number of sequences that are made for practice; longer practice begins again with the first."""


def study_set(folder: Path, config: StudyConfig, given: Path | None) -> SequenceSet | None:
    """The set of a study's sequences; None in a study of episodes.

    Args:
        folder: Folder of the study or of its export, for messages.
        config: The study.
        given: Where the set is.

    Raises:
        StudyError: The set is not given, or another one, or it is given to a study of episodes.
        DatasetError: It cannot be read.
    """
    if config.sequences is None:
        if given is not None:
            raise StudyError(
                f"--sequences {given}: found a set for a study of episodes ({folder / STUDY_FILE}); expected none. "
                "Leave it out, or write sequences: into a new study file."
            )
        return None
    if given is None:
        raise StudyError(
            f"{folder / STUDY_FILE}: has sequences, and no set was given; expected its folder. Add --sequences."
        )
    found = SequenceSet(given)
    if found.digest() != config.sequences.sha256:
        raise StudyError(
            f"--sequences {given}: has digest {found.digest()[:12]}; expected {config.sequences.sha256[:12]}, the "
            "study's. Give the set that the study is about, or correct the field of a study that is not planned."
        )
    return found


def sequences_by_key(root: SequenceSet, scene: str | None = None) -> dict[EpisodeKey, HomeSequence]:
    """The sequences of a set, or of one of its scenes, by the names that trials have.

    Raises:
        DatasetError: A file is damaged, or two sequences of one home have one name.
    """
    found: dict[EpisodeKey, HomeSequence] = {}
    for sequence in root.sequences(scenes=None if scene is None else (scene,)):
        found[sequence_key(sequence)] = sequence
    return found


def make_practice(
    folder: Path, home: str, *, seed: int, in_view: Sequence[Episode]
) -> tuple[tuple[EpisodeKey, ...], tuple[EpisodeKey, ...]]:
    """Writes the sequences of the practice home, and returns the names of those for practice and for attention trials.

    Practice has short beginnings of drawn sequences, up to the first search that a later message decides. An attention
    trial is a sequence of one search.

    Args:
        folder: The study's folder, whose practice home is there.
        home: Name of the practice home.
        seed: Seed of the draw.
        in_view: Episodes that begin with their target in plain view.

    Raises:
        StudyError: No sequence can be made in this home.
    """
    from sim.authoring.sequences.generation import draw_sequences

    out = folder / PRACTICE_SET / "content" / f"{home}.json.gz"
    if not out.is_file():
        root = folder / PRACTICE_FOLDER
        drawn = draw_sequences(root, [home], scenes_dir=None, count=PRACTICE_SEQUENCES, seed=seed, starts="invented")
        if home not in drawn.files:
            raise StudyError(
                f"{root}: the practice home carries no home sequence ({drawn.total.lines[:1]}); expected one. Change "
                "dataset.seed of the study file."
            )
        content = drawn.files[home]
        records = (*map(shortened, content.sequences), *map(_alone, in_view))
        write_whole(out, packed(content.model_copy(update={"sequences": records})))
    found = sequences_by_key(SequenceSet(folder / PRACTICE_SET))
    checks = tuple(key for key in found if key.episode_id.startswith(_IN_VIEW))
    return tuple(key for key in found if key not in checks), checks


def shortened(record: SequenceRecord) -> SequenceRecord:
    """The sequence up to its first search that a later message decides."""
    decided = [index for index, subtask in enumerate(record.subtasks) if subtask.message > 0]
    last = decided[0] if decided else len(record.subtasks) - 1
    fields = record.model_dump(by_alias=True)
    fields["subtasks"] = fields["subtasks"][: last + 1]
    fields["messages"] = [message for message in fields["messages"] if message["before"] <= last]
    return SequenceRecord.model_validate(fields)


def _alone(episode: Episode) -> SequenceRecord:
    """An episode as a sequence of one search, under a name that no other sequence of its home has."""
    name = f"{_IN_VIEW}{episode.key.split}-{episode.key.episode_id}"
    return sequence_from_episode(episode).model_copy(update={"sequence_id": name})
