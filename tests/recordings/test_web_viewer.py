"""Rerun's web viewer as we serve it: on loopback, with one folder or file, and without contact to other hosts."""

import http.client
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
import rerun as rr

from recordings.sinks import open_recording
from recordings.viewer import web
from recordings.viewer.process import running_rerun
from recordings.viewer.web import WebViewer, live_url, serve_file, serve_folder, serve_live, viewer_file, viewer_policy
from sim.errors import RecordingError

from .conftest import KEY
from .green_picture import GREEN, log_green, watched_picture


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a page, a recording of a green picture, and files that must not be served."""
    tmp_path = tmp_path_factory.mktemp("web")
    folder = tmp_path / "site"
    (folder / "below").mkdir(parents=True)
    (folder / "index.html").write_text("<h1>Episodes</h1>")
    (folder / "below" / "a page.html").write_text("<p>below</p>")
    (folder / ".hidden.html").write_text("hidden")
    (folder / "run.sqlite").write_text("not for browsers")
    (tmp_path / "outside.html").write_text("outside")
    (folder / "link.html").symlink_to(tmp_path / "outside.html")
    with open_recording(folder / "green picture.rrd", KEY) as stream:
        log_green(stream)
    return folder


@pytest.fixture(scope="module")
def site(folder: Path) -> Iterator[WebViewer]:
    """The web viewer that serves the folder."""
    with serve_folder(folder) as site:
        yield site


def ask(
    site: WebViewer, path: str, *, method: str = "GET", host: str | None = None, **more: str
) -> tuple[int, bytes, dict[str, str]]:
    """Status, content and headers (names in lower case) of a request with this exact path and `more` headers."""
    address = site.address.removeprefix("http://")
    connection = http.client.HTTPConnection(address, timeout=60)
    headers = {name.replace("_", "-"): value for name, value in more.items()}
    connection.request(method, path, headers={"Host": host or address} | headers)
    reply = connection.getresponse()
    content = reply.read()
    connection.close()
    return reply.status, content, {name.lower(): value for name, value in reply.getheaders()}


def test_a_folder_is_served_with_its_page_at_the_root_and_the_viewer_beside_it(site: WebViewer, folder: Path) -> None:
    assert ask(site, "/")[:2] == (200, b"<h1>Episodes</h1>")
    assert ask(site, "/below/a%20page.html")[:2] == (200, b"<p>below</p>")
    status, content, headers = ask(site, "/green%20picture.rrd")
    assert (status, content) == (200, (folder / "green picture.rrd").read_bytes())
    assert headers["content-type"] == "application/octet-stream"
    status, content, headers = ask(site, "/viewer/")
    assert status == 200
    assert b"re_viewer.js" in content
    assert headers["content-type"].startswith("text/html")
    assert ask(site, "/viewer/re_viewer_bg.wasm", method="HEAD")[2]["content-type"] == "application/wasm"


def test_head_gives_only_the_length_and_other_methods_and_hosts_are_refused(site: WebViewer) -> None:
    status, content, headers = ask(site, "/index.html", method="HEAD")
    assert (status, content, headers["content-length"]) == (200, b"", "17")
    assert ask(site, "/index.html", method="POST")[0] == 405
    assert ask(site, "/", host="evil.test")[:2] == (403, b"")
    assert ask(site, "/viewer/", host="evil.test:80")[:2] == (403, b"")


OUTSIDE = "/../outside.html /%2e%2e/outside.html /below/..%2f..%2foutside.html /..%5coutside.html //etc/passwd"
HIDDEN = "/link.html /.hidden.html /run.sqlite /below /below/ /none.html /a%00.html /viewer/../index.html /viewer/sw.js"


@pytest.mark.parametrize("path", [*OUTSIDE.split(), *HIDDEN.split(), "/" + "a" * 5000 + ".html"])
def test_nothing_else_is_served(site: WebViewer, path: str) -> None:
    assert ask(site, path)[:2] == (404, b"")


def test_one_file_is_served_without_its_neighbours(folder: Path) -> None:
    with serve_file(folder / "green picture.rrd") as site:
        assert ask(site, "/green%20picture.rrd")[0] == 200
        assert ask(site, "/index.html")[0] == 404
        status, _, headers = ask(site, "/")
        assert (status, headers["location"]) == (302, site.of_file("green picture.rrd"))
        assert "green%20picture.rrd&hide_welcome_screen=1" in headers["location"]


def test_a_link_to_a_recording_opens_the_viewer_which_may_contact_only_us_and_one_stream(site: WebViewer) -> None:
    status, _, headers = ask(site, "/green%20picture.rrd", Sec_Fetch_Dest="document")
    assert (status, headers["location"]) == (302, site.of_file("green picture.rrd"))
    assert ask(site, "/green%20picture.rrd", Sec_Fetch_Dest="empty")[0] == 200
    assert ask(site, "/none.rrd", Sec_Fetch_Dest="document")[0] == 404
    policy = ask(site, "/viewer/")[2]["content-security-policy"]
    assert policy == viewer_policy()
    assert "connect-src 'self';" in policy
    assert "default-src 'none'" in policy
    assert "'unsafe-inline'" not in policy.split("script-src")[1].split(";")[0]
    assert "connect-src 'self' http://127.0.0.1:9876;" in viewer_policy(9876)
    assert "connect-src 'self';" in ask(site, "/")[2]["content-security-policy"]


def test_the_page_of_the_viewer_loads_nothing_from_other_hosts() -> None:
    page = viewer_file("index.html")
    assert b"googleapis" not in page
    assert b"preconnect" not in page
    assert b'<script src="re_viewer.js">' in page
    assert page.index(b"console.debug") < page.index(b"re_viewer.js")


def test_the_files_of_the_viewer_are_fetched_from_rerun_once(monkeypatch: pytest.MonkeyPatch) -> None:
    content = viewer_file("re_viewer.js")

    def never(*arguments: str, **options: object) -> None:
        raise AssertionError("rerun was started again")

    monkeypatch.setattr(web, "running_rerun", never)
    viewer_file.cache_clear()
    web._taken_files.cache_clear()
    assert viewer_file("re_viewer.js") == content


def test_a_port_that_is_in_use_is_refused(site: WebViewer, folder: Path) -> None:
    port = int(site.address.rsplit(":", 1)[1])
    with pytest.raises(RecordingError, match=rf"port {port}: cannot be used"), serve_folder(folder, port=port):
        pass


@pytest.mark.browser
@pytest.mark.slow
def test_the_viewer_draws_a_recording_and_contacts_only_us(site: WebViewer) -> None:
    asked, refused = watched_picture(f"{site.address}/green%20picture.rrd", GREEN)  # the address of a link
    assert asked == {site.address.removeprefix("http://")}
    assert "tel.rerun.io" in refused, "the viewer no longer tries; the policy could be simpler"


def cpu_s(pid: int) -> float:
    """CPU seconds that a process has used (Linux)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.browser
@pytest.mark.slow
def test_a_live_stream_is_drawn_and_its_server_does_not_spin(folder: Path) -> None:
    with running_rerun("--serve-grpc") as server, serve_live(server.port) as site:
        stream = rr.RecordingStream("personal-viz", recording_id="live")
        stream.connect_grpc(live_url(server.port))
        log_green(stream)
        stream.flush()
        stream.disconnect()
        before_s = cpu_s(server.process.pid)
        asked, refused = watched_picture(site.address, GREEN)
        # a spinning server would use CPU for all the time that the page takes to load, at least 3 s
        assert cpu_s(server.process.pid) - before_s < 1.5
        assert asked == {site.address.removeprefix("http://"), f"127.0.0.1:{server.port}"}
        assert "tel.rerun.io" in refused
