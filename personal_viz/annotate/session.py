"""What one annotator does with a scan's objects, without a browser: select, draw a box, write, save, undo, search.

Clicks and texts -> `Session` -> appended edits (sim/authoring/annotations.py).
"""

import datetime
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Literal, NamedTuple

from pydantic import ValidationError

from sim.authoring.annotations import MAX_ID, AnnotatedObject, Box, Edit, append_edit, fold, read_edits, undo_of
from sim.errors import DatasetError, PersonalVizError, line_from_validation_error
from sim.homes.furniture.families import BY_WORDS
from sim.mesh import SceneObject
from sim.words.places import ROOM_KINDS

Point = tuple[float, float, float]
Side = Literal["bottom", "top"]
State = Literal["new", "begun", "complete", "kept", "changed", "flagged", "unsaved"]
CLEAR_OF_FLOOR = 0.03
"""A new box begins this far above the clicked floor, because the floor must not be in it (metres)."""
FIRST_HEIGHT = 0.8
"""Height of a new box until somebody changes it, metres."""
LEAST_HEIGHT, TALLEST = 0.02, 3.0
"""Heights of boxes, metres."""
_LEAST_SIDE = 0.05
"""Two corners nearer than this along an axis are a slip of the hand (metres)."""
_NEAR_BOX = 0.05
"""A click this far outside a box still means it, metres."""
_MOST_SUGGESTIONS = 6
_FURNITURE = sorted((name for name, _ in BY_WORDS), key=len)


@dataclass(frozen=True, slots=True)
class Form:
    """What stands in the fields for one object."""

    category: str = ""
    captions: tuple[str, ...] = ()
    room: str = ""
    storey: int = 0
    flagged: bool = False
    box: Box | None = None


class Row(NamedTuple):
    """An object in the list."""

    id: int
    category: str
    words: str
    """Its first caption, or empty."""
    state: State


class _Draft(NamedTuple):
    """An object that was changed and not saved yet."""

    base: AnnotatedObject | None
    """The object when the change began; an edit of somebody else since then is a conflict."""
    form: Form


class Session:
    """One annotator's selection and drafts over the edits of a scene, which others may append to at any time."""

    def __init__(
        self,
        path: Path,
        things: Iterable[SceneObject] = (),
        *,
        storeys: Sequence[float] = (),
        who: str = "",
        first: Mapping[int, Form] = MappingProxyType({}),
    ) -> None:
        """Reads the edits.

        Args:
            path: File of the scene's edits, made by the first one.
            things: Objects of the scan's semantics.
            storeys: Floor heights from below, metres.
            who: Name of the annotator; empty = not given yet.
            first: What the fields of objects show until somebody has edited them.

        Raises:
            DatasetError: The file is damaged.
        """
        self.who = who
        self.selected: int | None = None
        self.corner: Point | None = None
        """First corner of the box that is being drawn."""
        self.is_drawing = False
        """Whether clicks draw a box."""
        self._path = path
        self._things = {item.instance_id: item for item in things if 0 < item.instance_id <= MAX_ID}
        self._storeys, self._first = storeys, first
        self._drafts: dict[int, _Draft] = {}
        self._edits: tuple[Edit, ...] = read_edits(path)
        self._objects: Mapping[int, AnnotatedObject] = fold(self._edits)

    def refresh(self) -> bool:
        """Reads the edits again; whether there are others than before."""
        edits = read_edits(self._path)
        is_new = len(edits) != len(self._edits)
        self._edits, self._objects = edits, fold(edits)
        return is_new

    @property
    def form(self) -> Form:
        """The fields of the selected object: its draft, else the saved object, else what the semantics say."""
        number = self.selected
        if number is None:
            return Form()
        return self._drafts[number].form if number in self._drafts else self._saved_form(number)

    @property
    def is_unsaved(self) -> bool:
        """Whether the selected object has a draft."""
        return self.selected in self._drafts

    def saved(self, number: int) -> AnnotatedObject | None:
        """The saved object; None where nobody has edited it."""
        return self._objects.get(number)

    def rows(self, words: str = "") -> list[Row]:
        """The objects whose number, category, captions or room have all these words, in order of their numbers."""
        wanted = words.lower().split()
        found = []
        for number in sorted({*self._things, *self._first, *self._objects, *self._drafts}):
            form = self._drafts[number].form if number in self._drafts else self._saved_form(number)
            row = Row(number, form.category, form.captions[0] if form.captions else "", self._state(number))
            text = f"{number} {form.category} {' '.join(form.captions)} {form.room} {row.state}".lower()
            if all(word in text for word in wanted):
                found.append(row)
        return found

    def select(self, number: int) -> None:
        """Selects an object of the list; drafts of others stay."""
        self.leave()
        self.selected = number

    def leave(self) -> None:
        """Selects nothing and draws no box; drafts stay."""
        self.selected, self.is_drawing, self.corner = None, False, None

    def step(self, by: int, words: str = "") -> None:
        """Selects the next object of the list, or the previous one; after the last comes the first."""
        numbers = [row.id for row in self.rows(words)]
        if numbers:
            here = numbers.index(self.selected) if self.selected in numbers else (-1 if by > 0 else 0)
            self.select(numbers[(here + by) % len(numbers)])

    def draw_box(self) -> None:
        """The next two clicks are opposite corners of a new box on the floor."""
        self.leave()
        self.is_drawing = True

    def click(self, point: Point, instance_id: int) -> str:
        """Draws a corner, or selects the object at a place.

        Args:
            point: World metres.
            instance_id: Object of the semantics there, 0 = none.

        Returns:
            A line on what to do next; empty where an object is selected.
        """
        if self.is_drawing and self.corner is None:
            self.corner = point
            return "Now click the opposite corner on the floor."
        if self.is_drawing and self.corner is not None:
            box = box_between(self.corner, point)
            if box is None:
                return f"That is less than {100 * _LEAST_SIDE:.0f} cm from the first corner. Click the opposite one."
            self._start_box(box, point)
            return "Drag the arrows to its bottom and top, then describe the object."
        number = self._at(point) or (instance_id if instance_id in self._things else 0)
        if not number:
            return "No object is known here. Draw a new box around it (B)."
        self.select(number)
        return ""

    def keep(self, form: Form) -> None:
        """Remembers what stands in the fields of the selected object until it is saved."""
        number = self.selected
        if number is None:
            return
        draft = self._drafts.get(number)
        if draft is None and form != self._saved_form(number):
            self._drafts[number] = _Draft(self._objects.get(number), form)
        elif draft is not None and draft.base is not None and form == form_of(draft.base):
            del self._drafts[number]
        elif draft is not None:
            self._drafts[number] = replace_form(draft, form)

    def save(self) -> str:
        """Appends the selected object's draft; it is on disk when this returns a line that says so.

        Raises:
            DatasetError: Somebody else edited the object since; the draft is gone then, and the message repeats it.
            PersonalVizError: Nothing is selected, a field is wrong, or the annotator has no name.
        """
        number = self._require_selected()
        draft = self._drafts.get(number)
        if draft is None:
            draft = _Draft(self._objects.get(number), self.form)
        if draft.base is None and draft.form.box is not None:
            number = self._with_free_number(number)
        item = object_of(number, draft.form)
        if item == draft.base:
            return f"Object {number} is saved already."
        self._append(Edit(who=self._require_who(), utc=_now(), id=number, before=draft.base, after=item), draft.form)
        return f"Saved object {number}, {item.category}."

    def remove(self) -> str:
        """Appends the removal of the selected object, or drops its draft where it was never saved.

        Raises:
            DatasetError: Somebody else edited the object since.
            PersonalVizError: Nothing is selected, or the annotator has no name.
        """
        number = self._require_selected()
        draft = self._drafts.get(number)
        base = draft.base if draft is not None else self._objects.get(number)
        if base is not None:
            self._append(Edit(who=self._require_who(), utc=_now(), id=number, before=base, after=None), None)
        self._drafts.pop(number, None)
        if number not in self._things:
            self.selected = None
        return f"Removed object {number}." if base is not None else f"Dropped what was written on object {number}."

    def undo(self) -> str:
        """Drops the selected object's draft, or else appends the edit that takes back the annotator's last one.

        Edits that were undone before do not count, so repeated calls go back to the first edit, after a restart too.

        Raises:
            DatasetError: Somebody else edited the object since.
            PersonalVizError: There is nothing to undo, or the annotator has no name.
        """
        if self.selected is not None and self.is_unsaved:
            number = self.selected
            del self._drafts[number]
            if number not in {*self._things, *self._first, *self._objects}:
                self.selected = None
            return f"Dropped what was written on object {number} and not saved."
        who = self._require_who()
        self.refresh()
        last = last_not_undone(self._edits, who)
        if last is None:
            raise PersonalVizError(f"undo: found no edit of {who!r}; expected one. Only your own edits can be undone.")
        self._append(undo_of(last, who=who, utc=_now()), None)
        self._drafts.pop(last.id, None)
        self.select(last.id)
        if last.before is None and last.id not in {*self._things, *self._first}:
            self.selected = None
        return f"Took back the last edit of object {last.id}; saved."

    def categories(self, start: str) -> list[str]:
        """Suggestions for a category that begins so: words of this scan first, then those of the furniture."""
        known = [row.category for row in self.rows()]
        return suggestions(start, (*sorted(set(known), key=lambda word: (-known.count(word), word)), *_FURNITURE))

    def rooms(self, start: str) -> list[str]:
        """Suggestions for a room that begins so: those of this scan first."""
        known = sorted({item.room for item in self._objects.values()})
        return suggestions(start, (*known, *ROOM_KINDS))

    def place(self, number: int) -> SceneObject | None:
        """Where an object is: its box, or that of the semantics; None where it has neither."""
        form = self._drafts[number].form if number in self._drafts else self._saved_form(number)
        if form.box is not None:
            return SceneObject(0, f"{form.category}_{number}", form.category, form.box.centre, form.box.size)
        return self._things.get(number)

    def _saved_form(self, number: int) -> Form:
        saved = self._objects.get(number)
        if saved is not None:
            return form_of(saved)
        if number in self._first:
            return self._first[number]
        thing = self._things.get(number)
        return Form() if thing is None else Form(category=thing.category.lower(), storey=self._storey(thing.centre[1]))

    def _state(self, number: int) -> State:
        if number in self._drafts:
            return "unsaved"
        saved = self._objects.get(number)
        if saved is None:
            return "new"
        if saved.flagged:
            return "flagged"
        return "complete" if saved.is_complete else "begun"

    def _storey(self, y: float) -> int:
        """Number of the highest storey whose floor is not above this height."""
        return max((number for number, floor_y in enumerate(self._storeys) if floor_y <= y + 0.2), default=0)

    def _at(self, point: Point) -> int:
        """The smallest object with a box around a place, 0 = none."""
        found = []
        for number in {*self._objects, *self._drafts}:
            item = self.place(number)
            if item is None or item.instance_id:
                continue
            off = max(abs(a - c) - s / 2 for a, c, s in zip(point, item.centre, item.size, strict=True))
            if off <= _NEAR_BOX:
                found.append((item.size[0] * item.size[1] * item.size[2], number))
        return min(found, default=(0.0, 0))[1]

    def _start_box(self, box: Box, point: Point) -> None:
        number = max((0, *self._things, *self._objects, *self._drafts)) + 1
        self._drafts[number] = _Draft(None, Form(box=box, storey=self._storey(point[1])))
        self.select(number)

    def _with_free_number(self, number: int) -> int:
        """The number of a new box, or another one where somebody else has taken it since."""
        self.refresh()
        if number in self._objects:
            free = max((*self._things, *self._objects, *self._drafts)) + 1
            self._drafts[free] = self._drafts.pop(number)
            self.selected = number = free
        return number

    def _append(self, edit: Edit, form: Form | None) -> None:
        """Appends an edit; after a conflict the present state is read, and the draft is dropped."""
        try:
            append_edit(self._path, edit)
        except DatasetError as error:
            self.refresh()
            if self._objects.get(edit.id) == edit.before:
                raise  # the disk, not a colleague: the draft stays
            self._drafts.pop(edit.id, None)
            yours = "" if form is None else f" You wrote: {', '.join((form.category, *form.captions, form.room))}."
            raise DatasetError(f"{error}{yours}") from None
        self._drafts.pop(edit.id, None)
        self.refresh()

    def _require_selected(self) -> int:
        if self.selected is None:
            raise PersonalVizError(
                "no object is selected; expected one. Click an object, or one in the list, or draw a new box (B)."
            )
        return self.selected

    def _require_who(self) -> str:
        if not self.who.strip():
            raise PersonalVizError("your name is empty; expected one, because each edit has it. Type it at the top.")
        return " ".join(self.who.split())


def box_between(first: Point, second: Point, *, height: float = FIRST_HEIGHT) -> Box | None:
    """The upright box over two opposite corners on the floor, just above it; None where it has hardly any area."""
    (x0, y0, z0), (x1, y1, z1) = first, second
    if abs(x1 - x0) < _LEAST_SIDE or abs(z1 - z0) < _LEAST_SIDE:
        return None
    bottom = min(y0, y1) + CLEAR_OF_FLOOR
    size = (round(abs(x1 - x0), 3), height, round(abs(z1 - z0), 3))
    return with_height(Box(centre=(round((x0 + x1) / 2, 3), 0.0, round((z0 + z1) / 2, 3)), size=size), bottom, height)


def with_height(box: Box, bottom: float, height: float) -> Box:
    """The same box with another bottom (world metres) and height."""
    x, _, z = box.centre
    centre = (x, round(bottom + height / 2, 3), z)
    return Box(centre=centre, size=(box.size[0], round(height, 3), box.size[2]))


def with_side(box: Box, side: Side, y: float) -> Box:
    """The same box with its bottom or top at another height (world metres); the other one stays where it is.

    The height is a whole number of centimetres from LEAST_HEIGHT to TALLEST.
    """
    bottom, top = box.centre[1] - box.size[1] / 2, box.centre[1] + box.size[1] / 2
    wanted = y - bottom if side == "top" else top - y
    height = round(min(max(wanted, LEAST_HEIGHT), TALLEST), 2)
    return with_height(box, bottom if side == "top" else top - height, height)


def object_of(number: int, form: Form) -> AnnotatedObject:
    """The object that the fields describe; spaces too many and empty captions are dropped.

    Raises:
        PersonalVizError: A field cannot be so.
    """
    captions = tuple(text for text in (" ".join(caption.split()) for caption in form.captions) if text)
    try:
        return AnnotatedObject(
            id=number,
            category=" ".join(form.category.lower().split()),
            captions=captions,
            room=" ".join(form.room.split()),
            storey=form.storey,
            flagged=form.flagged,
            box=form.box,
        )
    except ValidationError as error:
        advice = "A category is a singular noun of letters. Correct the field, then save again."
        raise PersonalVizError(line_from_validation_error(f"object {number}", error, advice=advice)) from None


def form_of(item: AnnotatedObject) -> Form:
    """The fields of a saved object."""
    return Form(item.category, item.captions, item.room, item.storey, item.flagged, item.box)


def replace_form(draft: _Draft, form: Form) -> _Draft:
    """The draft with other fields; a box's place is kept where the fields have none."""
    return draft._replace(form=form if form.box is not None else replace(form, box=draft.form.box))


def last_not_undone(edits: Sequence[Edit], who: str) -> Edit | None:
    """The annotator's last edit that no later one of theirs takes back."""
    done: list[Edit] = []
    for edit in edits:
        if edit.who != who:
            continue
        if not edit.is_undo:
            done.append(edit)
        elif done:
            done.pop()
    return done[-1] if done else None


def suggestions(start: str, words: Iterable[str]) -> list[str]:
    """The first few names that begin so, then those of which a later word does, without the text itself."""
    start = " ".join(start.lower().split())
    unique = [word for word in dict.fromkeys(word.lower() for word in words) if word and word != start]
    begin = [word for word in unique if word.startswith(start)]
    later = [word for word in unique if word not in begin and any(part.startswith(start) for part in word.split())]
    return (begin + later)[:_MOST_SUGGESTIONS]


def _now() -> datetime.datetime:
    return datetime.datetime.now(datetime.UTC)
