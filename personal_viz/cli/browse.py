"""Worker of `personal-viz browse`: opens the library and serves it on this machine until Ctrl-C."""

import contextlib
import signal
import sys
import threading
from pathlib import Path

from personal_viz.printed import Console
from sim.errors import MissingDependencyError
from sim.types import ClutterLevel

from ..study_app.checked_options import require_no_scan


def browse(
    *,
    dataset: Path,
    runs: tuple[Path, ...] = (),
    scenes_dir: Path | None = None,
    scene: tuple[str, ...] = (),
    clutter: ClutterLevel = 0,
    port: int = 8090,
) -> int:
    """Serves episodes, homes, owners and runs for researchers, until Ctrl-C.

    Args:
        dataset: Folder of the episodes.
        runs: Run folders to show beside the episodes.
        scenes_dir: Folder of the scans; None = invented or schematic homes.
        scene: Scenes to list; none named = all.
        clutter: Level for homes without a scan.
        port: On 127.0.0.1; 0 takes a free one.

    Returns:
        0 after Ctrl-C; problems are raised as one-line errors.
    """
    require_no_scan("scan" if scenes_dir is not None else "schematic", clutter=clutter)
    try:
        from personal_viz.browse.app import browser_app
        from personal_viz.browse.library import open_library
    except OSError as error:
        raise MissingDependencyError(
            f"open3d: cannot be loaded ({error}); expected its system libraries. "
            "Install them: apt-get install -y libgl1 libegl1 libx11-6 libusb-1.0-0 libudev1 libgomp1"
        ) from None
    with Console(stderr=True).status("Reading episodes and runs") if sys.stderr.isatty() else contextlib.nullcontext():
        library = open_library(dataset, runs=runs, scenes_dir=scenes_dir, scenes=scene, clutter=clutter)
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    with browser_app(library, port=port) as address, contextlib.suppress(KeyboardInterrupt):
        homes = len(library.catalogue.scenes)
        print(f"{len(library.catalogue.episodes):,} episodes of {homes} home{'s' if homes > 1 else ''}: {address}")
        print("For researchers on this machine: it shows the goals. Ctrl-C ends it.", flush=True)
        ended.wait()
    return 0
