"""Which version of the program a participant's page came from, so that a page of before an upgrade is told apart.

A page keeps viser's client and our script for as long as it is open; a study that was updated and is served again talks
to it in other words. The version stands in the page (`static/updated.js`) and in the address of its websocket.
"""

import functools
import hashlib
import re
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path

import viser

from .page_script import STATIC

VISER_CLIENT = Path(viser.__file__).parent / "client" / "build" / "index.html"
PAGE_FILES = ("page.js", "tokens.css", "page.css", "updated.js")
"""Of `static`: what a page holds besides viser's client."""
SUBPROTOCOL = f"viser-v{viser.__version__}"
"""What viser's client of this version asks for."""
_PLACE = "PAGE_VERSION"
"""In `updated.js`, where the version goes."""


@functools.cache
def page_version() -> str:
    """12 hex digits of this program, of viser, and of every file that a page is made of."""
    hashed = hashlib.sha256(f"{version('personal-viz')} {viser.__version__}".encode())
    for path in (VISER_CLIENT, *(STATIC / name for name in PAGE_FILES)):
        hashed.update(hashlib.sha256(path.read_bytes()).digest())
    return hashed.hexdigest()[:12]


def page_of(served: str) -> bytes:
    """viser's client with our script that knows its version, and asks whether it is still the one that is served."""
    assert re.fullmatch(r"[\w.-]{1,64}", served, re.ASCII), served
    script = (STATIC / "updated.js").read_text(encoding="utf-8").replace(_PLACE, served)
    client = VISER_CLIENT.read_bytes()
    head, begin, rest = client.partition(b"<head>")
    assert begin, f"{VISER_CLIENT}: found no <head>"
    return b"".join((head, begin, b"<script>", script.encode(), b"</script>", rest))


def is_other_viser(offered: Iterable[str]) -> bool:
    """Whether a websocket asks for viser's protocol, and for none of this version."""
    asked = [name for name in offered if name.startswith("viser-v")]
    return bool(asked) and SUBPROTOCOL not in asked
