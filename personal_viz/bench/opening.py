"""How soon Chromium shows a home whose browser copy is made already, and a recording in Rerun's web viewer."""

import contextlib
import time
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import viser

from personal_viz.study_app.home.scene_view import SceneView, StoreyCopies
from recordings.viewer.web import serve_file

if TYPE_CHECKING:
    from playwright.sync_api import BrowserContext

_POLL_MS = 50
_WATCH_CANVAS = """
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
"""Notes after how many milliseconds a frame with a large mesh first had many colours; reading waits for the frame."""

_WATCH_VIEWER = """
window.viewerAtRest = new Promise((rest, never) => {
  const [width, height, restful, longestMs] = [320, 200, 30, 180000];
  const pixels = new OffscreenCanvas(width, height).getContext("2d", {willReadFrequently: true});
  pixels.imageSmoothingEnabled = false;
  const next = window.requestAnimationFrame.bind(window);
  const frames = [];
  let idle = 0;
  window.requestAnimationFrame = (callback) => next((at) => {
    const before = performance.now();
    callback(at);
    const canvas = document.getElementById("the_canvas_id");
    if (!canvas || !canvas.width || idle > restful) return;
    idle = performance.now() - before < 2 ? idle + 1 : 0;
    if (idle === 0) {
      pixels.drawImage(canvas, 0, 0, width, height);
      const colours = new Set(new Uint32Array(pixels.getImageData(0, 0, width, height).data.buffer)).size;
      frames.push([performance.now(), colours]);
    } else if (idle === restful) frames.length ? rest(frames) : idle = 0;
  });
  setTimeout(() => never(Error(`the viewer still draws after ${longestMs} ms`)), longestMs);
});
"""
"""Notes after how many milliseconds each frame was there (reading waits for it) and its colours, until none comes."""
_FILLED = 0.9
"""A recording is shown when the picture has this share of the colours that it has at rest."""


class Opening(NamedTuple):
    """Seconds since the page was asked for."""

    connected_s: float
    """When viser's page was there and asked for the home."""
    shown_s: float
    """When the canvas first showed it."""


def opening(browser: "BrowserContext", copies: StoreyCopies, *, storey: int = 0) -> Opening:
    """How soon a new page of a running viser server shows a storey, as participants get it.

    Args:
        browser: Of `personal_viz.browser.open_chromium`.
        copies: Of the home.
        storey: Index into the home's storeys.
    """
    with contextlib.ExitStack() as stack:
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        stack.callback(server.stop)
        server.scene.set_up_direction("+y")
        asked: list[float] = []

        @server.on_client_connect
        def _(client: viser.ClientHandle) -> None:
            asked.append(time.monotonic())
            SceneView(client, copies).show_storey(storey)

        page = browser.new_page()
        stack.callback(page.close)
        page.add_init_script(_WATCH_CANVAS)
        began = time.monotonic()
        page.goto(f"http://127.0.0.1:{server.get_port()}/")
        shown = page.wait_for_function("window.homeShownMs", polling=_POLL_MS).json_value()
        return Opening(asked[0] - began, shown / 1000)


def recording_opening_s(browser: "BrowserContext", rrd: Path) -> float:
    """Seconds after which Rerun's web viewer, asked for a recording, shows it with all its pictures and stays so.

    Args:
        browser: Of `personal_viz.browser.open_chromium`.
        rrd: The recording.
    """
    with serve_file(rrd) as site, contextlib.closing(browser.new_page()) as page:
        page.add_init_script(_WATCH_VIEWER)
        page.goto(f"{site.of_file(rrd.name)}&renderer=webgl")
        frames = page.evaluate("window.viewerAtRest")
    unfilled = [at for at, (_, colours) in enumerate(frames) if colours < _FILLED * frames[-1][1]]
    return frames[unfilled[-1] + 1 if unfilled else 0][0] / 1000
