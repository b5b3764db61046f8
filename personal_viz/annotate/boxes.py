"""The boxes in one annotator's 3-D view: those of described objects, and the selected one with handles to drag.

`Session` -> outlines; a drag of a handle -> a new bottom or top.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import viser

from sim.mesh import SceneObject

from ..browse.layers import MARKED_RGB, OBJECT_RGB, remove_nodes
from ..study_app.home.surfaces import add_ball, box_edges
from ..view.stage import WorkQueue
from .session import Session, Side

OnDrag = Callable[[Side, float, bool], None]
"""Side of the box, its new height over the world's zero (metres), and whether the hand has let go."""
_ARROW_PIXELS = 110
"""Length of a handle at any distance."""
_QUATS_WXYZ: dict[Side, tuple[float, float, float, float]] = {"top": (1, 0, 0, 0), "bottom": (0, 1, 0, 0)}
"""The handle at the top points up, that at the bottom down."""


class Boxes:
    """The boxes, and the handles of the selected one where it was drawn by hand."""

    def __init__(self, client: viser.ClientHandle, work: WorkQueue, on_drag: OnDrag) -> None:
        """Shows nothing yet; `on_drag` is called on the browser's thread."""
        self._client, self._work, self._on_drag = client, work, on_drag
        self._nodes: list[Any] = []
        self._handles: dict[Side, viser.TransformControlsHandle] = {}
        self._number: int | None = None
        """Object whose handles are shown."""

    def draw(self, session: Session, is_here: Callable[[SceneObject], bool]) -> None:
        """Outlines the described objects that are here thinly, and the selected one thickly with its category."""
        remove_nodes(self._nodes)
        rows = [row.id for row in session.rows() if row.state != "new" and row.id != session.selected]
        boxes = [item for item in map(session.place, rows) if item is not None and is_here(item)]
        self._add_lines("/boxes", boxes, OBJECT_RGB, 2.0)
        item = None if session.selected is None else session.place(session.selected)
        if item is not None:
            self._add_lines("/selected", [item], MARKED_RGB, 5.0)
            text = f"{session.selected} {session.form.category}".strip()
            corner = (item.centre[0] + item.size[0] / 2, item.centre[1] + item.size[1] / 2, item.centre[2])
            self._nodes.append(
                self._client.scene.add_label("/selected_label", text, position=corner, anchor="bottom-left")
            )
        if session.corner is not None:
            self._nodes.append(add_ball(self._client, "/corner", 0.03, session.corner))

    def place_handles(self, session: Session) -> None:
        """Puts handles at the selected box's top and bottom; an object of the semantics has none."""
        box = session.form.box
        if self._number != session.selected or box is None:
            for handle in self._handles.values():
                handle.remove()
            self._handles = {}
        if box is None:
            return
        self._number = session.selected
        (x, y, z), half = box.centre, box.size[1] / 2
        heights: dict[Side, float] = {"top": y + half, "bottom": y - half}
        for side, height in heights.items():
            if side not in self._handles:
                self._handles[side] = self._add_handle(side)
            self._handles[side].position = (x, height, z)

    def _add_handle(self, side: Side) -> viser.TransformControlsHandle:
        handle = self._client.scene.add_transform_controls(
            f"/{side}_handle",
            scale=_ARROW_PIXELS,
            line_width=5.0,
            fixed=True,
            active_axes=(False, True, False),
            disable_sliders=True,
            disable_rotations=True,
            depth_test=False,
            wxyz=_QUATS_WXYZ[side],
        )

        @handle.on_update
        async def _(event: viser.TransformControlsEvent) -> None:
            height = float(event.target.position[1])
            self._work.put(partial(self._on_drag, side, height, event.phase == "end"))

        return handle

    def _add_lines(self, name: str, items: Sequence[SceneObject], rgb: tuple[int, int, int], pixels: float) -> None:
        if items:
            edges = np.concatenate([box_edges(item.centre, item.size) for item in items])
            lines = self._client.scene.add_line_segments(name, edges, rgb, thickness=pixels, thickness_units="screen")
            self._nodes.append(lines)
