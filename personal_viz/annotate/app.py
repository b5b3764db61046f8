"""One annotator's browser: the scan with its objects, the fields of the selected one, its pictures, and the list.

Clicks, keys and texts -> `Session` -> appended edits -> what all browsers of this server show.
"""

import threading
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import viser

from sim.authoring.annotations import MOST_CAPTIONS, Box, annotation_path
from sim.errors import SceneError
from sim.mesh import SceneObject
from sim.walk.object_surface import object_ids_at

from ..browse.layers import look_at_object
from ..browse.messages import Words
from ..view.shown import Point, ShownScan
from ..view.stage import Ray, StoreyView, WorkQueue, free_keys, open_panel, panel_html
from .boxes import Boxes
from .panels import Notice, ObjectList, pictures_html, words_html
from .pictures import found_sights, pictures_of
from .session import LEAST_HEIGHT, TALLEST, Form, Session, Side, with_height, with_side

PANEL_WIDTH = 460
"""Pixels of the main panel."""
_LOW, _HIGH = -0.5, 3.5
"""Bottoms of boxes below and above the floor, metres."""
_WELCOME = "Click an object, or draw a new box around it."
_KEYS = {"c": "Category", "e": "Caption 1", "r": "Room", "f": "Search"}
"""Fields that keys lead to."""
_SAVING = ("Category", *(f"Caption {n}" for n in range(1, MOST_CAPTIONS + 1)), "Room")
"""Fields from which Enter saves."""
_HELP = (
    "Keys: E caption, C category, R room, F search, Enter or S save, U undo, N next, P previous, B new box, "
    "Escape none, Delete remove. Enter and Escape leave a field first."
)


class Workplace:
    """What all browsers of a server share: the scan, the file of edits, and who hears of new ones."""

    def __init__(self, shown: ShownScan, out: Path, *, who: str = "") -> None:
        """Opens no file yet.

        Args:
            shown: The scan.
            out: Folder of the dataset whose annotations are written.
            who: Name that each browser begins with.

        Raises:
            SceneError: A robot can stand nowhere in the scan.
            DatasetError: The scan's name cannot be that of a scene, or its annotations are damaged.
        """
        if shown.navigation is None:
            raise SceneError(f"{' '.join(shown.notes)} Annotations need floor: view points are places to stand.")
        self.shown, self.navigation, self.who = shown, shown.navigation, who
        self.path = annotation_path(out, shown.name)
        self.session()  # a damaged file is refused before a browser opens
        self.pictures = lru_cache(maxsize=128)(self._pictures)
        self._guests: list[Annotator] = []
        self._lock = threading.Lock()

    def session(self) -> Session:
        """A new annotator's session."""
        storeys = [part.floor_y for part in self.shown.parts]
        return Session(self.path, self.shown.objects, storeys=storeys, who=self.who)

    def join(self, guest: "Annotator") -> None:
        """The browser will hear of others' edits."""
        with self._lock:
            self._guests.append(guest)

    def leave(self, guest: "Annotator") -> None:
        """The browser is gone."""
        with self._lock:
            self._guests = [other for other in self._guests if other is not guest]

    def tell_others(self, guest: "Annotator") -> None:
        """Lets the other browsers read the edits again."""
        with self._lock:
            others = [other for other in self._guests if other is not guest]
        for other in others:
            other.hear()

    def object_at(self, point: Point, ray: Ray) -> int:
        """Id of the semantics' object at a place that a ray met, 0 = none."""
        direction = np.array([ray[1]], float)
        start = np.array([point]) - 0.01 * direction / np.linalg.norm(direction)
        hits = self.shown.caster.cast(start, direction)
        return int(object_ids_at(self.shown.mesh, hits.face_ids, hits.positions)[0])

    def _pictures(self, item: SceneObject) -> str:
        sights = found_sights(item, self.shown.mesh, navigation=self.navigation, renderer=self.shown.caster)
        pictures = pictures_of(item, sights, renderer=self.shown.caster)
        if not pictures:
            return panel_html(
                '<p class="warn">No place where a robot can stand sees it: no episode can ask for it.</p>'
            )
        return pictures_html(pictures, note="From view points; the object is outlined.")


class Fields:
    """The fields of the selected object."""

    def __init__(self, gui: viser.GuiApi) -> None:
        """Builds them, empty."""
        self.category = gui.add_text("Category", "", hint="Singular, lower case: the word of the queries.")
        self.categories = gui.add_html("")
        self.captions = [
            gui.add_text(f"Caption {n}", "", hint="What a person would say to tell it from others; empty = removed.")
            for n in range(1, MOST_CAPTIONS + 1)
        ]
        self.room = gui.add_text("Room", "", hint="Without an article: kitchen.")
        self.rooms = gui.add_html("")
        self.storey = gui.add_number("Storey", 0, min=-3, max=19, step=1, hint="0 is the ground floor.")
        self.flagged = gui.add_checkbox("Talk about it first", False, hint="Episodes do not ask for it.")
        self.bottom = gui.add_number(
            "Bottom (m)", 0.0, min=_LOW, max=_HIGH, step=0.01, hint="Above the floor.", visible=False
        )
        self.height = gui.add_number("Height (m)", 1.0, min=LEAST_HEIGHT, max=TALLEST, step=0.01, visible=False)

    @property
    def all(self) -> tuple[Any, ...]:
        """Those that a person changes."""
        return (
            self.category, *self.captions, self.room, self.storey, self.flagged, self.bottom, self.height,
        )  # fmt: skip

    def fill(self, form: Form, floor_y: float) -> None:
        """Shows an object; `floor_y` is the floor under it."""
        self.category.value, self.room.value = form.category, form.room
        for number, field in enumerate(self.captions):
            field.value = form.captions[number] if number < len(form.captions) else ""
        self.storey.value, self.flagged.value = form.storey, form.flagged
        self.fill_box(form.box, floor_y)
        self.show_captions()

    def fill_box(self, box: Box | None, floor_y: float) -> None:
        """Shows where a box begins and how high it is; an object of the semantics has none."""
        for field in (self.bottom, self.height):
            field.visible = box is not None
        if box is not None:
            self.bottom.value = round(box.centre[1] - box.size[1] / 2 - floor_y, 2)
            self.height.value = round(box.size[1], 2)

    def show_captions(self) -> None:
        """One empty field for a caption stands below the filled ones."""
        filled = [number for number, field in enumerate(self.captions) if field.value]
        for number, field in enumerate(self.captions):
            field.visible = number <= max(filled, default=-1) + 1

    def read(self, form: Form, floor_y: float) -> Form:
        """What stands in the fields; a box keeps its place, and its height unless a person changed it."""
        box = form.box
        if box is not None:
            bottom = round(box.centre[1] - box.size[1] / 2 - floor_y, 2)
            if (bottom, round(box.size[1], 2)) != (self.bottom.value, self.height.value):
                box = with_height(box, floor_y + self.bottom.value, self.height.value)
        return replace(
            form,
            category=self.category.value,
            captions=tuple(field.value for field in self.captions if field.value),
            room=self.room.value,
            storey=int(self.storey.value or 0),
            flagged=self.flagged.value,
            box=box,
        )


class Annotator:
    """State of one browser."""

    def __init__(self, client: viser.ClientHandle, place: Workplace) -> None:
        """Builds the panels, shows the lowest storey and starts to listen."""
        self._client, self._place, self._session = client, place, place.session()
        self._work = WorkQueue(client, lambda line: self._notice.warn(line))
        self._view = StoreyView(client, place.shown, self._work)
        self._slow = WorkQueue(client, lambda line: self._notice.warn(line))
        """Draws pictures, so that a drag does not wait for them."""
        self._boxes = Boxes(client, self._work, self._drag)
        self._turn = 0
        """Number of the last order for pictures; earlier ones are dropped."""
        self._build()
        self._list = ObjectList(client, self._work, self._obey)
        self._list.listen_to_search(self._work, self._draw_list)
        free_keys(client.gui, _KEYS, _SAVING)
        self._view.listen_to_clicks(self._click)
        place.join(self)
        self._work.put(partial(self._show_storey, 0))
        self._work.put(self._draw)

    def leave(self) -> None:
        """The browser is gone."""
        self._place.leave(self)
        self._turn += 1  # pictures that are being drawn are for nobody
        self._work.end()
        self._slow.end()

    def hear(self) -> None:
        """Somebody else has saved an edit."""
        self._work.put(self._refresh)

    def _build(self) -> None:
        gui, work, place, session = self._client.gui, self._work, self._place, self._session
        open_panel(gui, f"Annotate {place.shown.name}", PANEL_WIDTH)
        self._name = gui.add_text("Your name", place.who, hint="Each edit has it.")
        self._view.add_buttons(self._show_storey)
        self._notice = Notice(gui, _WELCOME)
        self._fields = Fields(gui)
        for field in self._fields.all:
            work.listen_to_change(field, self._changed)
        work.listen_to_change(self._name, self._take_name)
        acts: dict[str, tuple[str, Callable[[], None]]] = {
            "Save": ("S", partial(self._edit, session.save)),
            "Undo": ("U", partial(self._edit, session.undo)),
            "Previous": ("P", partial(self._step, -1)),
            "Next": ("N", partial(self._step, 1)),
            "New box": ("B", self._draw_box),
            "None": ("escape", self._deselect),
            "Remove": ("delete", partial(self._edit, session.remove)),
        }
        work.listen(gui.add_button("Save"), lambda _: acts["Save"][1]())
        buttons = gui.add_button_group("Object", tuple(acts)[1:], hint="None leaves the object and ends a new box.")
        work.listen(buttons, lambda label: acts[label][1]())
        for label, (key, obey) in acts.items():
            work.listen_to_key(label, key, obey)
        self._pictures = gui.add_html("")
        gui.add_html(f'<div class="bw"><p class="dim">{_HELP}</p></div>')

    def _obey(self, words: Words) -> None:
        """Obeys a click in our HTML."""
        match words:
            case ("object", number):
                self._session.select(int(number))
                self._enter()
            case ("category", *word):
                self._fields.category.value = " ".join(word)
                self._changed()
            case ("room", *word):
                self._fields.room.value = " ".join(word)
                self._changed()

    def _click(self, point: Point, ray: Ray) -> None:
        line = self._session.click(point, self._place.object_at(point, ray))
        self._notice.say(line)
        self._draw()

    def _drag(self, side: Side, height: float, is_end: bool) -> None:
        """Moves the top or the bottom of the box with the hand; pictures follow when it lets go."""
        form = self._session.form
        if form.box is None:
            return  # the object was left while the hand moved
        form = replace(form, box=with_side(form.box, side, height))
        self._session.keep(form)
        with self._client.atomic():
            self._fields.fill_box(form.box, self._floor_y())
            self._draw_boxes()
        if is_end:
            self._boxes.place_handles(self._session)
            self._draw_list()
            self._order_pictures()

    def _take_name(self) -> None:
        self._session.who = self._name.value

    def _changed(self) -> None:
        """Keeps what a person types; fields are not filled again under their hands."""
        self._session.keep(self._fields.read(self._session.form, self._floor_y()))
        self._fields.show_captions()
        self._draw_words()
        self._draw_list()
        self._draw_boxes()
        self._boxes.place_handles(self._session)
        if self._session.form.box is not None:
            self._order_pictures()

    def _edit(self, edit: Callable[[], str]) -> None:
        """Appends an edit, then shows the present state, also where somebody else was first."""
        try:
            self._notice.say(edit())
            self._place.tell_others(self)
        finally:
            self._draw()

    def _draw_box(self) -> None:
        self._session.draw_box()
        self._notice.say("Click one corner of the object on the floor.")
        self._draw()

    def _deselect(self) -> None:
        self._session.leave()
        self._notice.say(_WELCOME)
        self._draw()

    def _step(self, by: int) -> None:
        self._session.step(by, self._list.words)
        self._enter()

    def _refresh(self) -> None:
        if self._session.refresh() and self._session.is_unsaved:
            self._draw_list()  # the fields are not filled again under a person's hands
            self._draw_boxes()
        else:
            self._draw()

    def _enter(self) -> None:
        """Shows the selected object, on its storey."""
        self._notice.say("")
        item = self._selected()
        if item is not None:
            floors = [part.floor_y for part in self._place.shown.parts]
            storey = max((n for n, floor_y in enumerate(floors) if floor_y <= item.centre[1] + 0.2), default=0)
            if storey != self._view.index:
                self._view.show(storey, look=False)
            look_at_object(self._client, item.centre, item.size)
        self._draw()

    def _show_storey(self, index: int) -> None:
        self._view.show(index)
        self._draw_boxes()

    def _selected(self) -> SceneObject | None:
        number = self._session.selected
        return None if number is None else self._session.place(number)

    def _floor_y(self) -> float:
        """Height of the floor of the selected object's storey, to which its bottom refers."""
        item = self._selected()
        y = 0.0 if item is None else item.centre[1]
        floors = [part.floor_y for part in self._place.shown.parts]
        return max((floor_y for floor_y in floors if floor_y <= y + 0.2), default=floors[0])

    def _draw(self) -> None:
        """Shows all of the session's state."""
        with self._client.atomic():
            self._fields.fill(self._session.form, self._floor_y())
        self._draw_words()
        self._draw_list()
        self._draw_boxes()
        self._boxes.place_handles(self._session)
        self._order_pictures()

    def _draw_words(self) -> None:
        fields, session, is_open = self._fields, self._session, self._session.selected is not None
        fields.categories.content = words_html("category", session.categories(fields.category.value) if is_open else ())
        fields.rooms.content = words_html("room", session.rooms(fields.room.value) if is_open else ())

    def _draw_list(self) -> None:
        session = self._session
        self._list.show(session.rows(self._list.words), here=session.selected, total=len(session.rows()))

    def _draw_boxes(self) -> None:
        self._boxes.draw(self._session, self._is_here)

    def _is_here(self, item: SceneObject) -> bool:
        floors = [part.floor_y for part in self._place.shown.parts]
        above = [floor_y for floor_y in floors if floor_y > self._view.part.floor_y]
        return self._view.part.floor_y - 0.3 <= item.centre[1] < min(above, default=np.inf)

    def _order_pictures(self) -> None:
        """Pictures take a moment; only the last order counts."""
        self._turn += 1
        self._slow.put(partial(self._draw_pictures, self._turn, self._selected()))

    def _draw_pictures(self, turn: int, item: SceneObject | None) -> None:
        if turn != self._turn:
            return
        content = "" if item is None else self._place.pictures(item)
        if turn == self._turn:
            self._pictures.content = content
