"""Real Chromium shows a home's browser copy: its colours, its textures, no ceiling; and Rerun shows the same."""

import contextlib
import io
import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb
import viser
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import BrowserContext, Page

from personal_viz.bench.sim.scenes import bench_mesh
from personal_viz.screenshots.rerun_page import screenshot_rrd
from personal_viz.study_app.home.surfaces import SceneView, StoreyCopies
from recordings.scene import log_storeys
from sim.mesh import FLAT, VERTEX_COLOURS, Scene, TriangleMesh
from sim.plan_view.storey import storey_map
from sim.walk.floor_grid import floor_grid_from_mesh

pytestmark = pytest.mark.browser
GREEN, BLUE, MAGENTA = (60, 160, 60), (60, 60, 170), (255, 0, 255)
RED_TEXTURE, GREY = (170, 50, 50), (128, 128, 128)

WATCH_CANVAS = """
(() => {
  const draw = WebGL2RenderingContext.prototype.drawElements;
  let canvas = null;
  WebGL2RenderingContext.prototype.drawElements = function (mode, count, ...rest) {
    if (count >= 3000) canvas = this;
    return draw.call(this, mode, count, ...rest);
  };
  const next = window.requestAnimationFrame.bind(window);
  window.requestAnimationFrame = (callback) => next((at) => {
    callback(at);
    if (canvas === null || window.homeShownMs !== undefined) return;
    const number = canvas.drawingBufferWidth * canvas.drawingBufferHeight;
    const pixels = new Uint8Array(4 * number);
    canvas.readPixels(0, 0, canvas.drawingBufferWidth, canvas.drawingBufferHeight,
                      canvas.RGBA, canvas.UNSIGNED_BYTE, pixels);
    const colours = new Set();
    for (let k = 0; k < 4 * number; k += 388) colours.add(pixels[k] << 16 | pixels[k + 1] << 8 | pixels[k + 2]);
    if (colours.size >= 20) window.homeShownMs = performance.now();
  });
})();
"""
"""Notes the time in ms at which a frame with a large mesh first had many colours; reading waits for the frame."""


def room() -> Scene:
    """A floor in four parts (flat green, red texture, vertex colours of grey, flat grey), walls, a magenta ceiling."""
    quads, colours, looks = [], [], []

    def add(corners: list[list[float]], rgb: tuple[int, int, int], look: int = FLAT) -> None:
        quads.append(corners)
        colours.append(rgb)
        looks.append(look)

    for x, z, rgb, look in (
        (0, 0, GREEN, FLAT),
        (2.5, 0, GREEN, 0),
        (0, 2.5, GREEN, VERTEX_COLOURS),
        (2.5, 2.5, GREY, FLAT),
    ):
        add([[x, 0, z], [x, 0, z + 2.5], [x + 2.5, 0, z + 2.5], [x + 2.5, 0, z]], rgb, look)
    ring = [(0, 0), (5, 0), (5, 5), (0, 5), (0, 0)]
    for (xa, za), (xb, zb) in itertools.pairwise(ring):
        add([[xa, 0, za], [xb, 0, zb], [xb, 2.6, zb], [xa, 2.6, za]], BLUE)
    add([[0, 2.5, 0], [5, 2.5, 0], [5, 2.5, 5], [0, 2.5, 5]], MAGENTA)
    first = 4 * np.arange(len(quads))[:, None]
    faces = (first[:, :, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    vertices = np.array(quads, np.float32).reshape(-1, 3)
    mesh = TriangleMesh(
        vertices,
        faces.astype(np.int32),
        np.repeat(np.array(colours, np.uint8), 2, axis=0),
        np.zeros(len(faces), np.int32),
        np.repeat(np.array(looks, np.int16), 2),
        vertices[faces][..., [0, 2]].astype(np.float32),
        (np.tile(np.array(RED_TEXTURE, np.uint8), (64, 64, 1)),),
        np.tile(np.array(GREY, np.uint8), (len(vertices), 1)),
    )
    return Scene("Room", "scan", mesh, (), floor_grid_from_mesh(mesh), mesh.digest())


@contextmanager
def page_that_shows(browser: BrowserContext, copies: StoreyCopies) -> Iterator[Page]:
    """A viser page with the home's first storey from above."""
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    server.scene.set_up_direction("+y")

    @server.on_client_connect
    def _(client: viser.ClientHandle) -> None:
        client.gui.configure_theme(dark_mode=True)
        SceneView(client, copies).show_storey(0)
        client.camera.position, client.camera.look_at = (2.5, 6.0, 2.51), (2.5, 0.0, 2.5)
        client.flush()

    page = browser.new_page()
    try:
        page.goto(f"http://127.0.0.1:{server.get_port()}/")
        yield page
    finally:
        page.close()
        server.stop()


def pixels_of(png: bytes) -> NDArray[np.int64]:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def settled_pixels(page: Page, shows: Callable[[NDArray[np.int64]], bool]) -> NDArray[np.int64]:
    """The first picture of the page's canvas, panels cut away, that passes and stays; the last one if none does.

    A texture may arrive some frames after its mesh, and the camera after both.
    """
    previous = pixels = np.zeros((1, 1, 3), np.int64)
    for _ in range(100):
        pixels = pixels_of(page.screenshot())[160:, :900]
        if shows(pixels) and np.array_equal(pixels, previous):
            return pixels
        previous = pixels
        page.wait_for_timeout(300)
    return pixels


def share(pixels: NDArray[np.int64], condition: Callable[..., NDArray[np.bool_]]) -> float:
    return float(condition(*np.moveaxis(pixels, -1, 0)).mean())


def is_green(r, g, b):
    return (g > r + 40) & (g > b + 40)


def is_red(r, g, b):
    return (r > g + 50) & (r > b + 50)


def is_blue(r, g, b):
    return (b > r + 40) & (b > g + 40)


def is_magenta(r, g, b):
    return (r > g + 60) & (b > g + 60)


def greys_of(pixels: NDArray[np.int64]) -> NDArray[np.int64]:
    """Brightness of the greys, neither dark nor light, that cover more than 5 % of a picture."""
    rgb, count = np.unique(pixels.reshape(-1, 3), axis=0, return_counts=True)
    is_grey = (np.ptp(rgb, axis=1) <= 2) & (rgb[:, 0] > 60) & (rgb[:, 0] < 220)
    return rgb[is_grey & (count > 0.05 * count.sum()), 0]


def test_a_copy_is_shown_without_its_ceiling_and_all_its_colours_look_alike(browser: BrowserContext) -> None:
    with page_that_shows(browser, StoreyCopies(room())) as page:
        pixels = settled_pixels(
            page, lambda pixels: all(share(pixels, hue) > 0.02 for hue in (is_green, is_blue, is_red))
        )
    assert share(pixels, is_green) > 0.02, "the floor"
    assert share(pixels, is_blue) > 0.02, "walls"
    assert share(pixels, is_red) > 0.02, "the texture"
    assert share(pixels, is_magenta) == 0
    grey = greys_of(pixels)[0]
    assert np.ptp(greys_of(pixels)) <= 2, "flat colours and vertex colours"
    greens = share(pixels, is_green)
    assert share(pixels, lambda r, g, b: np.abs(r - grey) + np.abs(g - r) < 9) > 1.8 * greens, "two parts of the floor"


@pytest.mark.slow
def test_rerun_shows_vertex_colours_and_flat_colours_alike(tmp_path: Path) -> None:
    stream = rr.RecordingStream("test", recording_id="room")
    stream.save(tmp_path / "room.rrd")
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)
    home = room()
    log_storeys(stream, home, [storey_map(home.navigation, 0)])
    eye = rrb.EyeControls3D(position=(2.5, 6.0, 2.51), look_target=(2.5, 0.0, 2.5), eye_up=(0, 0, -1))
    view = rrb.Spatial3DView(origin="/", background=(24, 26, 30), line_grid=False, eye_controls=eye)
    stream.send_blueprint(rrb.Blueprint(view, auto_views=False, auto_layout=False, collapse_panels=True))
    stream.flush()
    stream.disconnect()
    png = screenshot_rrd(tmp_path / "room.rrd", tmp_path / "room.png", size=(900, 700))
    pixels = pixels_of(png.read_bytes())[100:]
    assert share(pixels, is_green) > 0.02
    assert share(pixels, is_magenta) == 0
    greys = greys_of(pixels)
    assert len(greys)
    assert np.ptp(greys) <= 2


def opening_s(browser: BrowserContext, copies: StoreyCopies, *, storey: int) -> float:
    """Seconds until a new page of a running viser server shows a storey, as participants get it."""
    with contextlib.ExitStack() as stack:
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        stack.callback(server.stop)
        server.scene.set_up_direction("+y")

        @server.on_client_connect
        def _(client: viser.ClientHandle) -> None:
            SceneView(client, copies).show_storey(storey)

        page = browser.new_page()
        stack.callback(page.close)
        page.add_init_script(WATCH_CANVAS)
        page.goto(f"http://127.0.0.1:{server.get_port()}/")
        return page.wait_for_function("window.homeShownMs", polling=50).json_value() / 1000


@pytest.mark.bench
def test_a_million_triangles_open_within_five_seconds(browser: BrowserContext) -> None:
    mesh = bench_mesh(1_000_000, cluttered=True)
    copies = StoreyCopies(Scene("Bench", "scan", mesh, (), floor_grid_from_mesh(mesh), mesh.digest()))
    seconds = sorted(opening_s(browser, copies, storey=1) for _ in range(5))
    assert seconds[2] <= 5.0, seconds
