"""Options of serving: unsafe ones are refused, and links begin with the right name."""

from pathlib import Path
from typing import Any

import pytest

from human_study.design.study import StudyEthics, StudyPog
from personal_viz.study_app.gateway.options import ServeOptions, require_may_serve
from sim.errors import StudyError

from .gateways import small_config

APPROVED = {"ethics": StudyEthics(irb="2026-17")}
NAMED: dict[str, Any] = {"bind": "0.0.0.0", "public": True, "hosts": ("study.example.org",), "proxy": "127.0.0.1"}


def test_an_approved_study_on_loopback_may_be_served() -> None:
    require_may_serve(ServeOptions(), small_config(**APPROVED), ["scan"])
    require_may_serve(ServeOptions(**NAMED), small_config(**APPROVED), ["scan", "invented"])


@pytest.mark.parametrize(
    ("options", "found"),
    [
        ({"bind": "0.0.0.0"}, r"--bind 0\.0\.0\.0: opens the study to other machines; expected --public"),
        ({"bind": "192.0.2.1"}, r"--bind 192\.0\.2\.1: opens the study"),
        ({"hosts": ("study.example.org",)}, r"--host study\.example\.org: opens the study"),
        ({"proxy": "127.0.0.1"}, "--proxy: opens the study"),
        ({"bind": "0.0.0.0", "public": True, "hosts": ("a.org",)}, "--public: without TLS .* expected --tls-cert"),
        ({"bind": "nonsense"}, "--bind nonsense: is not an address"),
        ({"public": True, "proxy": "127.0.0.1"}, "--public: found no name for browsers to call; expected --host"),
        ({**NAMED, "proxy": "the proxy"}, "--proxy the proxy: is not an address"),
        ({**NAMED, "hosts": ("a/b",)}, "--host a/b: is not a host name"),
        ({**NAMED, "proxy": None, "tls_cert": Path("no.pem")}, "--tls-cert and --tls-key: found one"),
        ({**NAMED, "proxy": None, "tls_cert": Path("no.pem"), "tls_key": Path("no.key")}, r"no\.pem: found no such"),
        ({"port": 70000}, "--port 70000: is not a port"),
        ({"workers": 65}, "--workers 65: expected 1 to 64"),
        ({"workers": 0}, "--workers 0: expected 1 to 64"),
        ({"max_people": 0}, "--max-people 0: expected at least 1"),
        ({"per_address": 0}, "--per-address 0: expected at least 1"),
    ],
)
def test_unsafe_options_are_refused_with_the_missing_flag(options: dict[str, Any], found: str) -> None:
    with pytest.raises(StudyError, match=found):
        require_may_serve(ServeOptions(**options), small_config(**APPROVED), ["invented"])


def test_geometry_of_scans_leaves_the_laboratory_only_with_the_flag_for_rights() -> None:
    pog = small_config(**APPROVED, pog_view="browser").model_copy(update={"task": ("pan", "pog")})
    require_may_serve(ServeOptions(), pog, ["scan"])
    require_may_serve(ServeOptions(**NAMED), pog, ["invented", "schematic"])
    require_may_serve(ServeOptions(**NAMED, i_have_rights=True), pog, ["scan"])
    glb = small_config(**APPROVED, memory={"arms": ("none", "glb")}, pog_view="browser")
    pictures = small_config(**APPROVED, memory={"arms": ("none", "topdown")})
    require_may_serve(ServeOptions(**NAMED), pictures, ["scan"])
    require_may_serve(ServeOptions(), glb, ["scan"])
    for config in (pog, glb):
        with pytest.raises(StudyError, match=r"geometry of scans .*matterport\.com.* --i-have-rights"):
            require_may_serve(ServeOptions(**NAMED), config, ["invented", "scan"])
        for view in ("auto", "server"):
            require_may_serve(ServeOptions(**NAMED), config.model_copy(update={"pog_view": view}), ["invented", "scan"])
    flat = pog.model_copy(update={"pog": StudyPog(conditions=("map_2d",))})
    require_may_serve(ServeOptions(**NAMED), flat, ["scan"])


@pytest.mark.parametrize(
    ("asked", "kind", "public", "view"),
    [
        ("auto", "scan", True, "server"),
        ("auto", "scan", False, "browser"),
        ("auto", "invented", True, "browser"),
        ("server", "invented", False, "server"),
        ("browser", "scan", True, "browser"),
    ],
)
def test_scans_that_are_served_to_others_are_drawn_on_the_server(
    asked: Any, kind: Any, public: bool, view: str
) -> None:
    assert small_config(pog_view=asked).view_of(kind, public=public) == view


def test_without_an_approval_only_a_pilot_is_served() -> None:
    with pytest.raises(StudyError, match=r"ethics\.irb is empty; .* --pilot"):
        require_may_serve(ServeOptions(), small_config(), ["invented"])
    require_may_serve(ServeOptions(pilot=True), small_config(), ["invented"])


@pytest.mark.parametrize(
    ("options", "address"),
    [
        ({}, "http://127.0.0.1:8080"),
        ({"bind": "localhost"}, "http://localhost:8080"),
        (NAMED, "https://study.example.org"),
        ({**NAMED, "hosts": ("study.example.org:8443",)}, "https://study.example.org:8443"),
        ({"public": True, "hosts": ("a.org",), "tls_cert": Path("c"), "tls_key": Path("k")}, "https://a.org:8080"),
        ({"public": True, "bind": "192.0.2.1", "tls_cert": Path("c"), "tls_key": Path("k")}, "https://192.0.2.1:8080"),
        ({"bind": "::1"}, "http://[::1]:8080"),
    ],
)
def test_personal_links_begin_with_the_name_that_browsers_call(options: dict[str, Any], address: str) -> None:
    assert ServeOptions(**options).address(8080) == address


def test_tls_of_the_proxy_holds_for_the_public_name_only() -> None:
    options = ServeOptions(**NAMED)
    assert options.is_secure("study.example.org")
    assert not options.is_secure("127.0.0.1:8080")
    assert options.host_names == {"127.0.0.1", "localhost", "::1", "study.example.org"}
    own = ServeOptions(public=True, hosts=("a.org",), tls_cert=Path("c"), tls_key=Path("k"))
    assert own.is_secure("127.0.0.1:8080")
