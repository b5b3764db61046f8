"""Runs a demo as a person does: waits for its links, opens one, ends it with Ctrl-C. Standard library only."""

import http.cookiejar
import json
import os
import re
import signal
import subprocess
import threading
import time
import urllib.request

LINK = re.compile(r"(http://127\.0\.0\.1:\d+)/#(\S+)")
READY = "Ctrl-C ends"


def run_demo(command, *, limit_s, **how):
    """(seconds to the printed links, all lines, the page behind the first link); `how` goes to Popen.

    Raises:
        RuntimeError: It printed no links in time, a page did not come, or Ctrl-C did not end it with exit code 0.
    """
    start, lines, linked_s = time.monotonic(), [], None
    piped = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    with subprocess.Popen(command, start_new_session=True, **piped, **how) as process:
        too_long = threading.Timer(limit_s, os.killpg, (process.pid, signal.SIGKILL))
        too_long.start()
        try:
            for line in process.stdout:
                print("  | " + line, end="", flush=True)
                lines.append(line)
                if linked_s is None and LINK.search(line):
                    linked_s = time.monotonic() - start
                if READY in line:
                    break
            if linked_s is None:
                raise RuntimeError(f"{command} printed no link within {limit_s} s (exit code {process.wait()})")
            page = open_link(*LINK.search("".join(lines)).groups())
            os.killpg(process.pid, signal.SIGINT)  # as a terminal does
            for line in process.stdout:
                print("  | " + line, end="", flush=True)
                lines.append(line)
            code = process.wait()
        finally:
            too_long.cancel()
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
    # GNU make ends itself by the signal, once its child has ended, and says *** where that had another code than 0.
    if code not in (0, -signal.SIGINT) or any("***" in line or "Traceback" in line for line in lines):
        raise RuntimeError(f"{command} did not end cleanly after Ctrl-C: exit code {code}")
    return linked_s, lines, page


def open_link(origin, token):
    """The page that a participant's browser gets behind a personal link, scripts not run."""
    opener = urllib.request.build_opener(
        urllib.request.ProxyHandler({}), urllib.request.HTTPCookieProcessor(http.cookiejar.CookieJar())
    )

    def fetch(path, body=None):
        headers = {"Origin": origin, "Content-Type": "application/json"}
        with opener.open(urllib.request.Request(origin + path, body, headers), timeout=60) as reply:
            return reply.read().decode()

    if "/static/enter.js" not in fetch("/"):
        raise RuntimeError(f"{origin}/ is not the entrance of a study")
    page = fetch(json.loads(fetch("/enter", json.dumps({"token": token}).encode()))["view"])
    if "<html" not in page:
        raise RuntimeError(f"{origin}: found no page behind the personal link, but {page[:80]!r}")
    return page
