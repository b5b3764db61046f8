"""Refining the captions of an edition: what each annotator decided on each object, how far they agree, what counts.

`<refined>/opinions/<annotator>/annotations/<Scene>.jsonl` holds one annotator's edits, and
`<refined>/adjudicated/annotations/<Scene>.jsonl` those of the person who chose between differing opinions. Annotators
have files of their own, so nobody's opinion depends on another's. `generate EDITION --captions <refined>` reads them.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Literal, NamedTuple

from pydantic import ValidationError

from sim.errors import DatasetError, line_from_validation_error

from ..episodes.dataset import PersonalDataset
from ..episodes.ownership import normalise_phrase
from .annotated import captioned_goals
from .annotations import AnnotatedObject, Change, annotation_path, fold, read_edits

Decision = Literal["kept", "changed", "flagged"]
_OPINIONS, _ADJUDICATED = "opinions", "adjudicated"


@dataclass(frozen=True, slots=True)
class Opinions:
    """What was decided on one object."""

    before: AnnotatedObject
    """As the edition has it."""
    said: Mapping[str, AnnotatedObject]
    """What each annotator made of it, by name; those who have not decided are missing."""
    adjudicated: AnnotatedObject | None
    """What somebody chose where annotators differ."""
    adjudicator: str = ""

    @property
    def differs(self) -> bool:
        """Whether annotators want different captions, or only some flagged it."""
        return len({(item.captions, item.flagged) for item in self.said.values()}) > 1

    @property
    def accepted(self) -> AnnotatedObject | None:
        """What was chosen, or else what all who decided want; None where they differ or nobody has decided."""
        if self.adjudicated is not None:
            return self.adjudicated
        return None if self.differs else next(iter(self.said.values()), None)

    @property
    def change(self) -> Change | None:
        """The accepted change; None where the object stays as it is."""
        after = self.accepted
        if after is None or after == self.before:
            return None
        return Change(self.before.id, (self.adjudicator,) if self.adjudicated else tuple(self.said), self.before, after)


class Agreement(NamedTuple):
    """How far two annotators agree."""

    first: str
    second: str
    num_both: int
    """Objects on which both decided."""
    num_equal: int
    """Those with the same decision: kept, changed or flagged."""
    num_changed: int
    """Those that both changed."""
    overlap: float
    """Mean share of words that their new captions have in common (intersection over union); 0 where there are none."""


def opinion_path(refined: Path, who: str, scene: str) -> Path:
    """The file of an annotator's edits of a scene.

    Raises:
        DatasetError: The name cannot be that of a folder.
    """
    try:
        annotation_path(refined, who)  # the same letters as in a scene's name
    except DatasetError:
        raise DatasetError(
            f"--who is {who!r}; expected 1-64 letters, digits, _ or -, because opinions get a folder of that name. "
            "Give another."
        ) from None
    return annotation_path(refined / _OPINIONS / who, scene)


def adjudication_path(refined: Path, scene: str) -> Path:
    """The file of the choices between differing opinions on a scene."""
    return annotation_path(refined / _ADJUDICATED, scene)


def asked_objects(dataset: PersonalDataset, scene: str) -> dict[int, AnnotatedObject]:
    """The objects that a scene's episodes ask for, by number, as the edition describes them.

    Raises:
        DatasetError: The episodes are damaged, or two objects have one number.
    """
    found: dict[int, AnnotatedObject] = {}
    for name, (goal, captions, room) in captioned_goals(dataset, scene).items():
        if goal.object_id in found:
            raise DatasetError(
                f"{dataset.root}: scene {scene!r}: {name} has the number {goal.object_id} of another object; expected "
                "a number of its own. Correct object_id in its goals."
            )
        try:
            found[goal.object_id] = AnnotatedObject(
                id=goal.object_id,
                category=goal.object_category.lower(),
                captions=tuple(" ".join(caption.split()) for caption in captions if caption.strip()),
                room=room,
                storey=int(goal.floor_id) if goal.floor_id.lstrip("-").isdigit() else 0,
            )
        except ValidationError as error:
            where = f"{dataset.root}: scene {scene!r}: {name}"
            raise DatasetError(
                line_from_validation_error(where, error, advice="Correct the episodes, or leave the scene out.")
            ) from None
    return dict(sorted(found.items()))


def read_opinions(refined: Path, scene: str, asked: Mapping[int, AnnotatedObject]) -> dict[int, Opinions]:
    """What was decided on each of a scene's objects, by number.

    Raises:
        DatasetError: A file is damaged.
    """
    said: dict[int, dict[str, AnnotatedObject]] = {number: {} for number in asked}
    for folder in sorted((refined / _OPINIONS).glob("*")):
        for number, item in fold(read_edits(annotation_path(folder, scene))).items():
            if number in said:
                said[number][folder.name] = item
    edits = read_edits(adjudication_path(refined, scene))
    chosen, who = fold(edits), {edit.id: edit.who for edit in edits}
    return {
        number: Opinions(before, said[number], chosen.get(number), who.get(number, ""))
        for number, before in asked.items()
    }


def decision_of(before: AnnotatedObject, after: AnnotatedObject) -> Decision:
    """What an annotator did with an object."""
    if after.flagged:
        return "flagged"
    return "kept" if after.captions == before.captions else "changed"


def agreements(opinions: Iterable[Opinions]) -> list[Agreement]:
    """The agreement of each pair of annotators over these objects, by their names."""
    decided = [one for one in opinions if one.said]
    names = sorted({name for one in decided for name in one.said})
    return [_agreement(first, second, decided) for first, second in combinations(names, 2)]


def _agreement(first: str, second: str, opinions: Sequence[Opinions]) -> Agreement:
    num_equal = 0
    overlaps: list[float] = []
    both = [one for one in opinions if first in one.said and second in one.said]
    for one in both:
        pair = one.said[first], one.said[second]
        decisions = {decision_of(one.before, item) for item in pair}
        num_equal += len(decisions) == 1
        if decisions == {"changed"}:
            overlaps.append(_overlap(*(" ".join(item.captions) for item in pair)))
    mean = sum(overlaps) / len(overlaps) if overlaps else 0.0
    return Agreement(first, second, len(both), num_equal, len(overlaps), mean)


def _overlap(first: str, second: str) -> float:
    words, others = (set(normalise_phrase(text).split()) for text in (first, second))
    return len(words & others) / len(words | others) if words | others else 1.0
