"""Caption refinement in one browser: each object of an edition with its old caption, a new one, and pictures; by keys.

Edition -> objects with captions -> `Session` of one annotator -> edits in that annotator's own files; or, in
adjudication, the objects on which annotators differ -> one choice each.
"""

import html
import threading
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import viser

from sim.authoring.annotated import captioned_goals
from sim.authoring.annotations import AnnotatedObject
from sim.authoring.refinement import (
    Agreement,
    Opinions,
    adjudication_path,
    agreements,
    asked_objects,
    decision_of,
    opinion_path,
    read_opinions,
)
from sim.episodes.dataset import PersonalDataset
from sim.homes.open_home import open_scene
from sim.homes.renderers import raycaster_of
from sim.mesh import Scene, SceneObject
from sim.words.english import how_many

from ..browse.messages import Words
from ..view.stage import WorkQueue, free_keys, open_panel, panel_html
from .panels import Notice, ObjectList, pictures_html
from .pictures import pictures_of, recorded_sights
from .session import Row, Session, form_of

PANEL_WIDTH = 780
"""Pixels of the main panel."""
_SIZE = (0.6, 0.6, 0.6)
"""Box around the recorded centre of an object that the home's semantics lack, metres."""
_NEW = "New caption"
_KEYS = {"e": _NEW, "f": "Search"}
_MOST_CHOICES = 9


@dataclass(frozen=True, slots=True)
class Refinement:
    """The options of the verb."""

    dataset: PersonalDataset
    out: Path
    who: str
    scenes: tuple[str, ...]
    scenes_dir: Path | None = None
    is_adjudication: bool = False
    """Whether a person chooses where others differ, rather than giving an opinion."""


class Edition:
    """What all browsers of a server share: the edition's objects by scene, their homes and pictures."""

    def __init__(self, options: Refinement) -> None:
        """Reads the objects and checks the files of opinions; homes are opened when they are looked at.

        Raises:
            DatasetError: The episodes or a file of edits are damaged, or the name cannot be that of a folder.
        """
        self.options = options
        self.asked: dict[str, dict[int, AnnotatedObject]] = {}
        for scene in options.scenes:
            self.asked[scene] = asked_objects(options.dataset, scene)
            opinion_path(options.out, options.who, scene)
            self.opinions(scene)
        self._lock = threading.Lock()
        self._homes = lru_cache(maxsize=3)(self._open)
        self._pictures = lru_cache(maxsize=256)(self._draw)

    def opinions(self, scene: str) -> dict[int, Opinions]:
        """What everybody has decided on a scene's objects until now."""
        return read_opinions(self.options.out, scene, self.asked[scene])

    def agreements(self) -> list[Agreement]:
        """The agreement of each pair of annotators over all scenes."""
        return agreements(one for scene in self.asked for one in self.opinions(scene).values())

    def session(self, scene: str) -> Session:
        """The annotator's session on a scene, or the adjudicator's on the objects on which others differ."""
        options = self.options
        opinions = self.opinions(scene)
        asked = {
            number: item
            for number, item in self.asked[scene].items()
            if not options.is_adjudication or opinions[number].differs
        }
        path = (
            adjudication_path(options.out, scene)
            if options.is_adjudication
            else opinion_path(options.out, options.who, scene)
        )
        return Session(path, who=options.who, first={number: form_of(item) for number, item in asked.items()})

    def pictures(self, scene: str, number: int) -> str:
        """Pictures of an object from its recorded view points, as HTML."""
        with self._lock:
            return self._pictures(scene, number)

    def _open(self, scene: str) -> Scene:
        return open_scene(self.options.dataset, scene, scenes_dir=self.options.scenes_dir)

    def _draw(self, scene: str, number: int) -> str:
        home = self._homes(scene)
        goals = captioned_goals(self.options.dataset, scene)
        name, goal = next((name, goal) for name, (goal, _, _) in goals.items() if goal.object_id == number)
        unknown = SceneObject(0, name, goal.object_category, goal.position, _SIZE)
        item = next((item for item in home.objects if item.name == name), unknown)
        pictures = pictures_of(item, recorded_sights(goal, item.centre), renderer=raycaster_of(home))
        return pictures_html(pictures, note=f"From recorded view points in {home.label}; the object is outlined.")


class Refiner:
    """State of one browser."""

    def __init__(self, client: viser.ClientHandle, edition: Edition) -> None:
        """Builds the panels and shows the first object that is not decided."""
        self._client, self._edition = client, edition
        self._scenes = list(edition.asked)
        self._scene = self._scenes[0]
        self._session = edition.session(self._scene)
        self._opinions = edition.opinions(self._scene)
        self._work = WorkQueue(client, lambda line: self._notice.warn(line))
        self._turn = 0
        self._build()
        free_keys(client.gui, _KEYS, [_NEW])
        self._work.put(self._start)

    def leave(self) -> None:
        """The browser is gone."""
        self._work.end()

    def _build(self) -> None:
        gui, work = self._client.gui, self._work
        is_adjudication = self._edition.options.is_adjudication
        title = "Choose between captions" if is_adjudication else "Refine captions"
        open_panel(gui, f"{title}: {self._edition.options.who}", PANEL_WIDTH)
        self._scene_choice = gui.add_dropdown("Scene", tuple(self._scenes))
        self._notice = Notice(gui)
        self._old = gui.add_html("")
        self._new = gui.add_text(_NEW, "", hint="E goes here; Enter saves.")
        work.listen_to_change(self._new, self._changed)
        acts = {
            "Keep": ("K", self._keep),
            "Save": ("S", self._save),
            "Flag": ("G", self._flag),
            "Previous": ("P", partial(self._step, -1)),
            "Next": ("N", partial(self._step, 1)),
            "Undo": ("U", self._undo),
        }
        buttons = gui.add_button_group("K S G P N U", tuple(acts), hint="Keys: E new caption, F search; Enter saves.")
        work.listen(buttons, lambda label: acts[label][1]())
        for label, (key, obey) in acts.items():
            work.listen_to_key(label, key, obey)
        if is_adjudication:
            for number in range(1, _MOST_CHOICES + 1):
                work.listen_to_key(f"Choose {number}", str(number), partial(self._choose, number))
        self._agreement = gui.add_html("")
        self._pictures = gui.add_html("")
        self._list = ObjectList(self._client, work, self._obey)
        self._list.listen_to_search(work, self._draw_list)
        work.listen_to_change(self._scene_choice, lambda: self._go_to(self._scene_choice.value))

    def _obey(self, words: Words) -> None:
        match words:
            case ("object", number):
                self._session.select(int(number))
                self._draw()
            case ("choose", number):
                self._choose(int(number))

    def _start(self) -> None:
        """Shows the first object of all scenes that is not decided, else the first one."""
        for scene in self._scenes:
            self._take(scene)
            number = next((row.id for row in self._rows() if row.state == "new"), None)
            if number is not None:
                self._session.select(number)
                break
        else:
            self._take(self._scenes[0])
            self._session.step(1)
            self._notice.say("Every object is decided." if self._rows() else "No opinions differ.")
        self._read_opinions()
        self._draw()

    def _take(self, scene: str) -> None:
        if scene != self._scene:
            self._scene, self._session = scene, self._edition.session(scene)
            self._scene_choice.value = scene
        self._opinions = self._edition.opinions(scene)

    def _go_to(self, scene: str) -> None:
        self._take(scene)
        self._session.step(1)
        self._draw()

    def _step(self, by: int) -> None:
        """Goes to the next object; after a scene's last one comes the next scene."""
        numbers = [row.id for row in self._rows()]
        here = self._session.selected
        is_end = not numbers or here == numbers[-1 if by > 0 else 0]
        if is_end and len(self._scenes) > 1:
            self._take(self._scenes[(self._scenes.index(self._scene) + by) % len(self._scenes)])
            self._session.leave()
        self._session.step(by, self._list.words)
        self._draw()

    def _changed(self) -> None:
        """Keeps what a person types until it is saved."""
        if self._session.selected is None:
            return
        captions = (self._new.value, *self._before().captions[1:])
        self._session.keep(replace(self._session.form, captions=tuple(text for text in captions if text)))
        self._draw_list()

    def _decide(self, captions: tuple[str, ...], *, flagged: bool = False) -> None:
        """Saves a decision on the selected object, then shows the next one."""
        self._session.keep(replace(self._session.form, captions=captions, flagged=flagged))
        try:
            line = self._session.save()
        finally:
            self._draw()
        number = self._session.selected
        self._read_opinions()
        state = next((row.state for row in self._rows() if row.id == number), "")
        self._step(1)
        self._notice.say(f"{line.rstrip('.')}: {state}.")

    def _keep(self) -> None:
        if self._session.selected is not None:
            self._decide(self._before().captions)

    def _save(self) -> None:
        """Saves the new caption; an empty one keeps the old."""
        if self._session.selected is not None:
            new = " ".join(self._new.value.split())
            self._decide((new, *self._before().captions[1:]) if new else self._before().captions)

    def _flag(self) -> None:
        if self._session.selected is not None:
            self._decide(self._session.form.captions, flagged=True)

    def _choose(self, number: int) -> None:
        """Takes what one of the annotators said."""
        said = list(self._opinions[self._session.selected].said.values()) if self._session.selected is not None else []
        if number <= len(said):
            self._decide(said[number - 1].captions, flagged=said[number - 1].flagged)

    def _undo(self) -> None:
        try:
            self._notice.say(self._session.undo())
        finally:
            self._read_opinions()
            self._draw()

    def _read_opinions(self) -> None:
        self._opinions = self._edition.opinions(self._scene)
        self._agreement.content = _agreement_html(self._edition.agreements())

    def _before(self) -> AnnotatedObject:
        assert self._session.selected is not None, "no object"
        return self._edition.asked[self._scene][self._session.selected]

    def _rows(self) -> list[Row]:
        """The objects of the scene, with what was decided on each."""
        rows = []
        for row in self._session.rows(self._list.words):
            saved = self._session.saved(row.id)
            is_decided = saved is not None and row.state != "unsaved"
            state = decision_of(self._edition.asked[self._scene][row.id], saved) if is_decided and saved else row.state
            rows.append(row._replace(state=state))
        return rows

    def _draw(self) -> None:
        number = self._session.selected
        if number is None:
            self._old.content, self._pictures.content = "", ""
        else:
            before, form = self._before(), self._session.form
            is_open = self._session.saved(number) is None and not self._session.is_unsaved
            self._new.value = "" if is_open or not form.captions else form.captions[0]
            said = self._opinions[number].said if self._edition.options.is_adjudication else {}
            self._old.content = _old_html(before, said)
            self._turn += 1
            self._work.put(partial(self._draw_pictures, self._turn))
        self._draw_list()

    def _draw_list(self) -> None:
        self._list.show(self._rows(), here=self._session.selected, total=len(self._session.rows()))

    def _draw_pictures(self, turn: int) -> None:
        number: Any = self._session.selected
        if turn == self._turn and number is not None:
            self._pictures.content = panel_html(f'<p class="dim">Pictures in {html.escape(self._scene)} …</p>')
            self._client.flush()
            self._pictures.content = self._edition.pictures(self._scene, number)


def _old_html(before: AnnotatedObject, said: Any) -> str:
    """The object with its old caption, and in adjudication what each annotator said."""
    old = "<br>".join(html.escape(caption) for caption in before.captions) or "no caption"
    lines = []
    for number, (who, item) in enumerate(said.items(), start=1):
        words = html.escape("; ".join(item.captions) or "no caption")
        decision = decision_of(before, item)
        lines.append(
            f'<div class="row" data-click="choose {number}"><b>{number} {html.escape(who)}</b>'
            f'<span class="words">{words}</span><span class="tag {decision}">{decision}</span></div>'
        )
    choices = f'<div class="bw an"><div class="rows">{"".join(lines)}</div></div>' if lines else ""
    place = html.escape(f"{before.id} {before.category}, {before.room or 'no room'}")
    return panel_html(f'<h2>{place}</h2><p class="dim">Old caption</p><p class="old">{old}</p>') + choices


def _agreement_html(pairs: list[Agreement]) -> str:
    """A line for each pair of annotators."""
    lines = []
    for pair in pairs:
        both = how_many(pair.num_both, "object")
        line = f"{pair.first} and {pair.second}: {pair.num_equal} of {both} decided equally"
        if pair.num_changed:
            line += f"; {100 * pair.overlap:.0f} % of the words in common where both changed ({pair.num_changed})"
        lines.append(f'<p class="agreement">{html.escape(line)}.</p>')
    return panel_html("".join(lines)) if lines else ""
