"""One picture of a home: its storeys from above, four views of rooms, and one of each category of objects.

Scene (and plan) -> PNG. Nothing is staged: views are what a robot sees, portraits what the home is built of.
"""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from PIL.PngImagePlugin import PngInfo

from human_study.export.text_tables import csv_lines
from sim.files import write_whole
from sim.frames import T_world_camera
from sim.homes.furniture.families import look_of
from sim.homes.kind import scene_label, scene_terms
from sim.homes.plan import HomePlan
from sim.homes.renderers import raycaster_of
from sim.mesh import Scene
from sim.render.renderer import Renderer
from sim.types import Camera

from .plan import storey_picture
from .portrait import portrait
from .views import CROP_SIDE, category_crops, room_views

NUM_VIEWS = 4
WIDTH = NUM_VIEWS * Camera().width
PER_ROW = WIDTH // CROP_SIDE
_PLAN_HEIGHT = 1000
_TITLE, _CAPTION = 64, 34
"""Heights of the title and of a line under a picture, pixels."""
_PAPER = (250, 249, 246)
_INK = (30, 30, 36)
_MAX_NAMED = 6
"""Categories named under a view."""

Tile = tuple[Image.Image, str]
"""A picture and the words under it."""


def contact_sheet_picture(scene: Scene, plan: HomePlan | None, *, facts: str = "") -> Image.Image:
    """The contact sheet of a home, WIDTH pixels wide.

    Args:
        scene: The home.
        plan: Names the rooms, and its pieces are drawn as portraits; None (a scan) = objects are cut out of views.
        facts: A line at the foot; empty = none.
    """
    renderer = raycaster_of(scene)
    heights = scene.navigation.storey_heights
    size = (WIDTH // len(heights), _PLAN_HEIGHT)
    storeys = [
        (storey_picture(scene, plan, floor_y, size=size), f"storey at {floor_y:.1f} m, from above")
        for floor_y in heights
    ]
    if plan is not None:
        tiles = portraits(plan)
    else:
        tiles = [(Image.fromarray(crop.rgb), crop.item.category) for crop in category_crops(scene, renderer)]
    rows = [storeys, _views(scene, plan, renderer)]
    rows += [tiles[first : first + PER_ROW] for first in range(0, len(tiles), PER_ROW)]
    said = (scene.label, scene_label(scene.kind), scene_terms(scene.kind), facts)
    return _stacked(*said, [row for row in rows if row])


def portraits(plan: HomePlan) -> list[Tile]:
    """Each category of the plan once, by family: a captioned piece where there is one, with its category and family."""
    first: dict[str, int] = {}
    order = sorted(range(len(plan.furniture)), key=lambda k: (plan.furniture[k].role != "captioned", k))
    for index in order:
        first.setdefault(plan.furniture[index].category, index)
    tiles = []
    for category, index in sorted(first.items(), key=lambda item: (look_of(item[0]).family, item[0])):
        family = look_of(category).family
        words = category if family in category else f"{category} ({family})"
        tiles.append((Image.fromarray(portrait(plan.furniture[index], side=CROP_SIDE)), words))
    return tiles


def write_crops(folder: Path, scene: Scene, *, seed: int = 0) -> int:
    """Writes one crop of each category without any label, and `<scene>-key.csv` that tells them; returns their number.

    Crops are numbered in a random order, so that neither names nor order give the answer away.

    Raises:
        OSError: The folder cannot be written.
    """
    crops = category_crops(scene, raycaster_of(scene))
    order = np.random.default_rng(seed).permutation(len(crops)).tolist()
    lines = []
    for number, crop in enumerate((crops[index] for index in order), start=1):
        name, category = f"{scene.name}-{number:03d}.png", crop.item.category
        write_whole(folder / name, png_bytes(Image.fromarray(crop.rgb)))
        family = look_of(category).family
        lines.append((name, category, family, crop.item.name, scene.kind, scene_label(scene.kind)))
    heads = ("file", "category", "family", "object", "scene_kind", "scene_label")
    write_whole(folder / f"{scene.name}-key.csv", csv_lines(heads, lines))
    return len(crops)


def png_bytes(picture: Image.Image, *, label: str = "", **options: Any) -> bytes:
    """The picture as PNG with a label of the kind of home; the same pixels and Pillow `options` give the same bytes."""
    data, about = io.BytesIO(), PngInfo()
    if label:
        about.add_text("Description", label)
    picture.save(data, "PNG", pnginfo=about, **options)
    return data.getvalue()


def _views(scene: Scene, plan: HomePlan | None, renderer: Renderer) -> list[Tile]:
    """NUM_VIEWS first-person views at 640 x 480, named after the room that each shows."""
    rooms: dict[int, str] = {}
    if plan is not None:
        ids = {item.name: item.instance_id for item in scene.objects}
        rooms = {ids[piece.name]: piece.room for piece in plan.furniture if piece.name in ids}
    tiles = []
    for view in room_views(scene, renderer, rooms=rooms, count=NUM_VIEWS):
        frame = renderer.render(T_world_camera(view.pose, Camera()), Camera())
        named = ", ".join(view.objects[:_MAX_NAMED])
        tiles.append((Image.fromarray(frame.rgb), f"{view.room}: {named}" if view.room else named))
    return tiles


def _stacked(title: str, label: str, terms: str, facts: str, rows: Sequence[Sequence[Tile]]) -> Image.Image:
    """Rows of pictures, spread over the width, under a title with a label beside it; facts and terms at the foot."""
    heights = [max(picture.height for picture, _ in row) + _CAPTION for row in rows]
    feet = [line for line in (facts, terms) if line]
    sheet = Image.new("RGB", (WIDTH, _TITLE + sum(heights) + _CAPTION * len(feet)), _PAPER)
    draw = ImageDraw.Draw(sheet)
    draw.text((16, _TITLE // 2), title, font=ImageFont.load_default(size=34), anchor="lm", fill=_INK)
    draw.text((WIDTH - 16, _TITLE // 2), label, font=ImageFont.load_default(size=20), anchor="rm", fill=_INK)
    top = _TITLE
    for row, height in zip(rows, heights, strict=True):
        slot = WIDTH // max(len(row), PER_ROW if row[0][0].width <= CROP_SIDE else 1)
        for index, (picture, words) in enumerate(row):
            left = index * slot + (slot - picture.width) // 2
            sheet.paste(picture, (left, top))
            font = _font_for(words, slot - 8, draw)
            draw.text(
                (index * slot + slot // 2, top + height - _CAPTION // 2), words, font=font, anchor="mm", fill=_INK
            )
        top += height
    for number, line in enumerate(feet):
        place = (16, top + number * _CAPTION + _CAPTION // 2)
        draw.text(place, line, font=ImageFont.load_default(size=17), anchor="lm", fill=_INK)
    return sheet


def _font_for(words: str, width: int, draw: ImageDraw.ImageDraw) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """The largest letters of a few sizes that fit into `width` pixels, or the smallest."""
    for size in (20, 17, 14, 12, 10):
        font = ImageFont.load_default(size=size)
        if draw.textlength(words, font=font) <= width:
            break
    return font
