"""`make gallery`: a folder that any static host serves, in which every address is relative and leads somewhere."""

import functools
import shutil
import threading
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import urljoin, urlsplit

import pytest

from personal_viz.screenshots import gallery
from personal_viz.screenshots.gallery import GallerySize, make_gallery
from recordings.sinks import open_recording
from recordings.viewer.web import VIEWER_FILES, viewer_file
from sim.errors import RecordingError
from sim.types import EpisodeKey

from ..recordings.green_picture import GREEN, log_green, watched_picture
from .html_tags import Tags

SMALLEST = GallerySize(
    bots=2, tasks=("pan",), splits={"easy": 1}, steps=8, seconds=120.0, agents=("random",), explored_steps=5
)


class Quiet(SimpleHTTPRequestHandler):
    """Serves a folder without a line for each request."""

    def log_message(self, format: str, *args: object) -> None: ...


@contextmanager
def static_host(folder: Path) -> Iterator[str]:
    """Address at which Python's plain file server serves the folder, below another one as on many hosts."""
    handler = functools.partial(Quiet, directory=str(folder.parent))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_address[1]}/{folder.name}/"
        finally:
            server.shutdown()
            thread.join()


def read(address: str) -> bytes:
    with urllib.request.urlopen(address, timeout=60) as reply:
        return reply.read()


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small gallery; only read."""
    out = tmp_path_factory.mktemp("site") / "gallery"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gallery, "RELEASE", out / "nowhere")
        assert make_gallery(out, SMALLEST) == out / "index.html"
    return out


@pytest.mark.slow
def test_a_static_host_serves_the_gallery_and_every_address_leads_somewhere(out: Path) -> None:
    with static_host(out) as home:
        pages, seen, recordings = [home], set[str](), list[bytes]()
        while pages:
            here = pages.pop()
            text = read(here).decode()
            if here == home:
                assert "made by bots and agents, on homes that are invented or schematic" in text
            elif "/viewer/" not in here:
                assert "By bots and agents, on invented homes: no person took part." in text
            if "/viewer/" in here:
                continue  # the viewer's own page, whose links to other hosts its policy makes useless
            tags = Tags(text).found
            assert "icon" in [names.get("rel") for _, names in tags], here  # else browsers ask the host's root for one
            for address in [found for _, names in tags for name in ("href", "src") if (found := names.get(name))]:
                target = urljoin(here, address.partition("#")[0]) if not address.startswith("data:") else here
                assert not urlsplit(address).netloc, address
                assert not address.startswith("/"), address
                assert target.startswith(home), address
                if target in seen or target == here:
                    continue
                seen.add(target)
                content = read(target)
                assert content, target
                if target.endswith(".html"):
                    pages.append(target)
                if target.endswith(".rrd"):
                    recordings.append(content)
        assert [content[:4] for content in recordings] == 2 * [b"RRF2"]  # an episode and an exploration
        assert {f"{home}{name}" for name in ("report/report.html", "compare/index.html", "gallery.js")} <= seen
        for name in VIEWER_FILES[1:]:
            assert read(f"{home}viewer/{name}") == viewer_file(name)
        viewer = read(f"{home}viewer/index.html").decode()
    assert viewer.index('http-equiv="Content-Security-Policy"') < viewer.index("<script")
    assert "connect-src 'self'; base-uri 'none'" in viewer
    assert not [path for path in out.rglob("*") if path.suffix in (".db", ".key") or path.name == "keys.json"]


@pytest.mark.browser
@pytest.mark.slow
@pytest.mark.parametrize(("page", "link"), [("index.html", "a[data-recording]"), ("compare/index.html", "a.replay")])
def test_a_link_to_a_recording_opens_it_in_the_viewer_of_the_gallery(
    page: str, link: str, out: Path, tmp_path: Path
) -> None:
    copy = shutil.copytree(out, tmp_path / "gallery")
    for recording in copy.rglob("*.rrd"):
        with open_recording(recording, EpisodeKey("easy", "Invented7", "1")) as stream:
            log_green(stream)
    with static_host(copy) as home:
        asked, refused = watched_picture(f"{home}{page}", GREEN, link=link)
        assert asked == {urlsplit(home).netloc}
    assert "tel.rerun.io" in refused, "the viewer no longer tries; the policy could be simpler"


def test_a_folder_with_other_files_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(RecordingError, match=r"holds other files; expected an empty folder or an earlier gallery"):
        make_gallery(tmp_path)
    assert (tmp_path / "thesis.tex").read_text() == "years of work"
