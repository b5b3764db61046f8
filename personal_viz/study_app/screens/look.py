"""The look screens: a home before the task, in pictures from above or as a 3-D model, with a clock, without texts."""

import base64
import functools
import html
from collections.abc import Sequence

from human_study.design.study import StudyPog
from human_study.trial.commands import CloseMap
from human_study.trial.views import LookView

from ..home.homes import Home
from ..home.surfaces import HomeSurface
from ..home.top_view import TopView
from .camera import NamesButton, StoreyButtons, add_camera_buttons, sample_camera
from .page import Page, Send, overlay_html, roomy_html


class LookScreen:
    """Draws a look at a home on a page and turns presses into commands."""

    def __init__(
        self,
        page: Page,
        view: LookView,
        send: Send,
        *,
        home: Home,
        caption: str,
        storeys: Sequence[str],
        shown: StudyPog,
    ) -> None:
        """Builds the screen.

        Args:
            page: The participant's page.
            view: The first view.
            send: Receives the commands.
            home: The home.
            caption: HTML with the trial's name and the kind of home, without the home's name.
            storeys: Name of each storey, the lowest first.
            shown: Says which names the home has.
        """
        self._page, self._home, self._shown, self._caption = page, home, view, caption
        page.clear()
        self._status = page.add(page.client.gui.add_html(""))
        self._surface: HomeSurface | None = None
        if view.what == "topdown":
            self._picture = page.overlay("")
        else:
            self._surface = surface = home.shown_in(page.client, shown)
            page.add(surface)
            sample_camera(page, send)
            page.listen_to_camera(surface.camera_moved)
        self._storeys, self._storey_names = StoreyButtons(page, storeys, send), storeys
        self._names = NamesButton(page, self._surface, send, is_there=shown.has_names_on_demand)
        if self._surface is not None:
            add_camera_buttons(page, is_map=False)
        begin, close = page.words(f"look.{view.what}_begin"), functools.partial(send, CloseMap())
        with page.always_visible("bottom"):
            page.button(begin, close, color="green")
        page.hotkey("enter", begin, close)
        self._show_storey(view.storey)
        self._names.show(is_shown=view.has_names)
        self._draw_status()

    def show(self, view: LookView) -> None:
        """Draws the changes of the view."""
        before, self._shown = self._shown, view
        if view.storey != before.storey:
            self._show_storey(view.storey)
        self._names.show(is_shown=view.has_names)
        if (view.wait_s, view.left_s, view.storey) != (before.wait_s, before.left_s, before.storey):
            self._draw_status()

    def _show_storey(self, index: int) -> None:
        self._storeys.show(index)
        if self._surface is not None:
            self._surface.show_storey(index)
        else:
            alt = self._page.words("camera.picture", storey=self._storey_names[index])
            self._picture.content = overlay_html(picture_html(self._home.copies.maps[index], alt))
            self._page.client.flush()

    def _draw_status(self) -> None:
        view, words = self._shown, self._page.words
        around = {} if view.what == "topdown" else {"advice": words("pog.home_advice")}
        title, advice = words(f"look.{view.what}_title"), words(f"look.{view.what}_advice", **around)
        clock = words("look.unlimited")
        if view.left_s is not None:
            clock = words("look.left_time", time=words.countdown(view.left_s))
        if view.wait_s:
            clock += " " + words("look.wait_time", time=words.countdown(view.wait_s))
        longest = words("number.clock", minutes=88, seconds=88)  # reserves room, so that nothing below moves
        longest = f"{words('look.left_time', time=longest)} {words('look.wait_time', time=longest)}"
        title, advice, clock = html.escape(title), html.escape(advice), html.escape(clock)
        self._status.content = (
            f'<div class="personal-caption">{self._caption}</div>'
            f'<div class="personal-text personal-look"><p class="personal-query">{title}</p><p>{advice}</p>'
            f'<div role="timer"><b>{roomy_html(clock, longest)}</b></div></div>'
        )
        self._page.client.flush()


@functools.lru_cache(maxsize=16)
def picture_html(view: TopView, alt: str) -> str:
    """A storey's picture as large as the screen allows, with words for those who do not see it."""
    data = base64.b64encode(view.jpeg()).decode()
    return (
        f'<img alt="{html.escape(alt)}" src="data:image/jpeg;base64,{data}" '
        'style="max-width:100%;max-height:100vh;object-fit:contain">'
    )
