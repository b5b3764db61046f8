"""The POG screen: texts beside the home or its map, storey buttons, a movable mark, a button to confirm. No feedback.

`click_of` turns a browser's rays and moves of the mark, on the home and on its map, into the session's clicks.
"""

import html
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import viser
import viser.transforms

from human_study.design.study import StudyPog
from human_study.trial.commands import Click, Confirm, GiveUp, Unmark
from human_study.trial.events import ABOVE_MAP, object_ray
from human_study.trial.views import Mark, PogView
from sim.tasks.run_files import ClickRay, Vector3

from ..home.homes import Home
from ..home.surfaces import Surface, map_click
from .camera import SIDES, NamesButton, StoreyButtons, add_camera_buttons, add_group, four, sample_camera, three
from .page import Page, Send, relabel, roomy_html, show_giving_up
from .texts import TaskTexts, news_of

NUDGE_M = 0.1
"""Distance by which one press moves the mark (metres): a tenth of the success radius."""
_UNDER_CUT = 0.01
"""Distance under the cut from which the ray of a moved mark starts in the home (metres)."""
_WXYZ_DOWN = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
"""A camera (OpenCV axes) that looks straight down: right = +x, down = +z."""


@dataclass(frozen=True, slots=True)
class Nudge:
    """A move of the newest mark over the ground; where that stands on another storey, or nowhere, one starts in the
    middle of the storey that is shown."""

    x_m: float
    z_m: float
    """Moves along x and z, world metres."""
    is_new: bool = False
    """In a search for all: whether the mark stays where it is, and a new one is set here."""


class PogScreen:
    """Draws one POG trial on a page and turns clicks into rays and commands."""

    def __init__(
        self,
        page: Page,
        view: PogView,
        send: Send,
        *,
        surface: Surface,
        caption: str,
        storeys: Sequence[str],
        shown: StudyPog,
        things: Sequence[str],
        has_history: bool = True,
    ) -> None:
        """Builds the screen.

        Args:
            page: The participant's page.
            view: The first view.
            send: Receives commands, rays of clicks, and moves of the mark.
            surface: The home, or its map.
            caption: HTML with the trial's name and the kind of home, without the home's name.
            storeys: Name of each storey, the lowest first.
            shown: Says where marks go, and which names the home has.
            things: Categories of the objects to which a mark may go.
            has_history: In home sequences, whether messages of earlier searches can be read again.
        """
        self._page, self._send, self._surface, self._caption = page, send, surface, caption
        self._snaps, self._longest_thing = shown.pointing == "snap", max(things, key=len, default="")
        self._shown = view
        self._texts = TaskTexts(page, has_history=has_history)
        page.clear()
        page.add(self)
        with page.always_visible("top"):
            self._texts.add_query(view)
        self._status = page.add(page.client.gui.add_html(""))
        self._texts.add_description(view)
        self._storeys = StoreyButtons(page, storeys, send)
        self._names = NamesButton(page, surface, send, is_there=shown.has_names_on_demand)
        add_camera_buttons(page, is_map=surface.is_map)
        self._add_nudges()
        self._of_all: list[viser.GuiButtonHandle] = []
        if view.num_searches is not None:
            one_more = partial(send, Nudge(0.0, 0.0, is_new=True))
            self._of_all.append(page.button(page.words("pog.one_more"), one_more))
        with page.always_visible("bottom"):
            if view.num_searches is not None:
                self._of_all.append(page.button(page.words("pog.unmark"), self._unmark))
            self._confirm = page.button(page.words("pog.confirm"), partial(send, Confirm()), color="green")
            self._give_up = page.button(page.words("give_up.button"), partial(send, GiveUp()), color="gray")
        page.client.scene.on_click()(self._on_click)  # type: ignore[arg-type]  # viser awaits it
        sample_camera(page, send)
        page.listen_to_camera(surface.camera_moved)
        surface.show_storey(view.storey)
        self._names.show(is_shown=view.has_names)
        self._draw_mark()
        self._draw_status()

    def show(self, view: PogView) -> None:
        """Draws the changes of the view."""
        before, self._shown = self._shown, view
        if view.storey != before.storey:
            self._surface.show_storey(view.storey)
        self._names.show(is_shown=view.has_names)
        self._texts.show(view)
        if (view.marks, view.storey) != (before.marks, before.storey):
            self._draw_mark()
        if _status_of(view) != _status_of(before):
            self._draw_status()

    def remove(self) -> None:
        """Takes the home out of the browser and stops listening to clicks; `Page.clear` calls it."""
        self._page.client.scene.remove_click_callback(self._on_click)
        self._surface.remove()

    def _add_nudges(self) -> None:
        page = self._page
        order = ("left", "up", "down", "right")
        add_group(page, page.words("pog.move"), order, self._nudge, hint=page.words("pog.move_keys"))
        for name in order:
            page.hotkey(f"arrow{name}", f"move the mark {name}", partial(self._nudge, name))

    async def _unmark(self) -> None:
        await self._send(Unmark(len(self._shown.marks) - 1))

    async def _nudge(self, name: str) -> None:
        """Moves the mark in the direction that the screen shows, for any direction of the camera."""
        right, up = SIDES[name]
        R_world_camera = viser.transforms.SO3(np.asarray(self._page.client.camera.wxyz, float)).as_matrix()
        along = right * R_world_camera[:, 0] - up * R_world_camera[:, 1]  # the camera's y points down
        length = float(np.hypot(along[0], along[2]))
        if length > 0:
            x_m, _, z_m = (NUDGE_M * along / length).tolist()
            await self._send(Nudge(x_m, z_m))

    def _draw_mark(self) -> None:
        """Draws the marks of the shown storey; while another is shown, the buttons of their storeys tell of them."""
        view = self._shown
        self._storeys.show(view.storey, {mark.storey for mark in view.marks})
        numbered = list(enumerate(view.marks, start=1))
        shown = [(mark, self._label(mark, number)) for number, mark in numbered if mark.storey == view.storey]
        self._surface.show_marks(shown)

    def _label(self, mark: Mark, number: int) -> str:
        words = self._page.words
        name = words("pog.mark_number", number=number) if self._shown.is_for_all else words("pog.your_mark")
        return name if mark.item is None else words("pog.mark_on", mark=name, thing=mark.item.category)

    def _draw_status(self) -> None:
        view = self._shown
        words, mark = self._page.words, view.mark
        around = words("pog.map_advice" if self._surface.is_map else "pog.home_advice")
        if view.is_for_all:
            unmarked = words("pog.unmarked_all_snap" if self._snaps else "pog.unmarked_all", advice=around)
            marked = words("pog.marked_all")
        else:
            unmarked = words("pog.unmarked_snap" if self._snaps else "pog.unmarked", advice=around)
            marked = words("pog.marked")
        longest = words("pog.marked_item", thing=self._longest_thing)
        advice = unmarked if mark is None else marked
        if mark is not None and mark.item is not None and not view.is_for_all:
            advice = words("pog.marked_item", thing=mark.item.category)
        # `longest` is longer than `marked` in every language
        advices = unmarked, longest if self._snaps and not view.is_for_all else marked
        relabel(self._confirm, words("pog.confirm_all" if view.is_for_all else "pog.confirm"))
        for button in self._of_all:
            if button.visible != view.is_for_all:
                button.visible = view.is_for_all
        advice, left = html.escape(advice), ""
        if view.left_s is not None:
            time = html.escape(words("pog.left_time", time=words.duration(view.left_s)))
            left = f'<div role="timer">{time}</div>'
        self._status.content = (
            f'<div class="personal-caption">{self._caption}</div>'
            f'<div class="personal-text personal-line"><b>{roomy_html(advice, *advices)}</b>{left}</div>'
        )
        news = "" if view.marks or view.is_over else news_of(view, words)
        self._page.sign(words("give_up.armed") if view.is_giving_up else news, is_news=not view.is_giving_up)
        show_giving_up(self._give_up, words, is_giving_up=view.is_giving_up)
        self._page.client.flush()

    async def _on_click(self, event: viser.SceneClickEvent) -> None:
        camera = event.client.camera
        ray = ClickRay(
            origin=three(event.ray_origin),
            direction=three(event.ray_direction),
            camera_position=three(camera.position),
            camera_wxyz=four(camera.wxyz),
            storey_y=self._shown.storeys[self._shown.storey],
        )
        await self._send(ray)


def _status_of(view: PogView) -> tuple[object, ...]:
    return view.mark is None, view.mark and view.mark.item, view.is_giving_up, view.left_s, view.search


def click_of(pointed: ClickRay | Nudge, view: PogView, home: Home, *, is_map: bool, snaps: bool = False) -> Click:
    """The click on the shown storey, with the object there.

    Args:
        pointed: A ray, which was sent with the storey that the browser showed then, or a move of the mark.
        view: The present view.
        home: The trial's home.
        is_map: Whether the participant points at the home's map, not at the home.
        snaps: Whether the mark goes to the middle of that object, unless it is a part of the building.
    """
    ray = pointed if isinstance(pointed, ClickRay) else _straight_down(pointed, view, home, is_map=is_map)
    storey = view.storeys.index(ray.storey_y)
    if is_map:
        click = map_click(home.copies.maps[storey], ray)
    else:
        click = Click(ray, home.pog_scene.hit(storey, ray.origin, ray.direction))
    item = home.pog_scene.object_at(storey, *object_ray(ray, click.hit, click.pixel)) if click.hit is not None else None
    if item is None:
        return click
    snapped = home.pog_scene.middle_of(storey, item) if snaps and not item.is_building else None
    return replace(click, object_name=item.name, snapped=snapped)


def _straight_down(nudge: Nudge, view: PogView, home: Home, *, is_map: bool) -> ClickRay:
    """The ray from above through the moved mark, or through the middle of a storey that has no mark.

    A mark that went to the middle of an object is moved from the place that was clicked, or it would never leave.
    """
    floor_y = view.storeys[view.storey]
    cut = home.copies.cuts[view.storey]
    x, z = home.copies.middle(view.storey)
    if view.mark is not None and view.mark.storey == view.storey:
        x, z = view.mark.hit[0] + nudge.x_m, view.mark.hit[2] + nudge.z_m
    origin: Vector3 = (x, floor_y + ABOVE_MAP if is_map else cut.top_y - _UNDER_CUT, z)
    return ClickRay(
        origin=origin,
        direction=(0.0, -1.0, 0.0),
        camera_position=origin,
        camera_wxyz=_WXYZ_DOWN,
        storey_y=floor_y,
    )
