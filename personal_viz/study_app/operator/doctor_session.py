"""Takes part for a moment with a personal link: enters, opens the websocket through the proxy, waits for viser."""

import http.cookies
import importlib.metadata
import json
import time

import msgspec
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from ..first_camera import CAMERA
from .doctor_site import TIMEOUT_S, Check, Site

FIRST_MESSAGE_S = 30.0


def check_session(site: Site, token: str) -> Check:
    """A participant gets in and is sent a page.

    Args:
        site: Where the study is.
        token: Of a personal link; stands in no message of ours.
    """
    entered = site.ask("/enter", headers={"Origin": site.origin}, body=json.dumps({"token": token}).encode())
    if entered.status != 200:
        advice = "Copy a whole personal link of this study; after ten wrong ones wait a minute."
        return Check("session", False, f"entering was refused (status {entered.status})", advice)
    view = json.loads(entered.body)["view"]
    url = view.partition("websocket=")[2]
    expected = f"{'wss' if site.context is not None else 'ws'}://{site.netloc}/"
    if not url.startswith(expected):
        advice = f"Serve with --host {site.netloc} and let the proxy pass Host on with its port."
        return Check("session", False, f"the page would call {url.partition('/ws/')[0]}; expected {expected}", advice)
    if b"viser" not in site.ask(view).body.lower():
        return Check("session", False, "the view is not viser's page", "Let the proxy pass query strings on unchanged.")
    cookies = http.cookies.SimpleCookie(entered.headers.get("set-cookie", ""))
    pair = "; ".join(f"{name}={morsel.value}" for name, morsel in cookies.items())
    began_s = time.monotonic()
    with connect(
        url,
        ssl=site.context,
        subprotocols=[Subprotocol(f"viser-v{importlib.metadata.version('viser')}")],
        additional_headers={"Cookie": pair, "Origin": site.origin},
        open_timeout=TIMEOUT_S,
        close_timeout=1,
        max_size=None,
        proxy=None,
    ) as connection:
        connection.send(msgspec.msgpack.encode(CAMERA))
        connection.recv(timeout=FIRST_MESSAGE_S)
        first_s = time.monotonic() - began_s
        pinged_s = time.monotonic()
        connection.ping().wait(TIMEOUT_S)
        ping_ms = (time.monotonic() - pinged_s) * 1000
    return Check("session", True, f"the first message came after {first_s:.1f} s; a ping takes {ping_ms:.0f} ms")
