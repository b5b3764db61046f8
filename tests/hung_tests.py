"""Ends a process of pytest whose test hangs where no exception reaches it, so that a run has a name to show for it."""

import faulthandler
import os
import threading
from collections.abc import Generator

import pytest

LIMIT_S = 300.0
"""Longest test with its fixtures, in wall-clock seconds; a test's own mark `timeout` replaces it."""
BEYOND_S = 150.0
"""Seconds after which a test counts as hung that pytest-timeout has interrupted at its limit."""


class EndsHungTests:
    """A pytest plugin: prints all stacks and ends the process; xdist then names the test.

    pytest's own `faulthandler_timeout` is off as soon as a test has failed, and its fixtures may still hang then.
    """

    def __init__(self, *, limit_s: float = LIMIT_S, beyond_s: float = BEYOND_S) -> None:
        """Made before pytest captures what processes print."""
        self._limit_s, self._beyond_s, self._stderr = limit_s, beyond_s, os.dup(2)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, bool, bool]:
        """Waits beside the test."""
        own = item.get_closest_marker("timeout")
        longest_s = (own.args[0] if own else self._limit_s) + self._beyond_s
        timer = threading.Timer(longest_s, self._end, args=(item.nodeid, longest_s))
        timer.daemon = True
        timer.start()
        try:
            return (yield)
        finally:
            timer.cancel()

    def _end(self, test: str, longest_s: float) -> None:
        os.write(self._stderr, f"{test} hangs: {longest_s:g} s are over\n".encode())
        faulthandler.dump_traceback(self._stderr)
        os._exit(1)
