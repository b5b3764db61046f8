"""Runs and answers as Rerun recordings.

The public names are loaded when they are first used: `import recordings` itself loads nothing heavy.
"""

from typing import TYPE_CHECKING

from sim.public_names import loaders_of

if TYPE_CHECKING:
    from .observer import RerunObserver as RerunObserver
    from .read import read_rrd as read_rrd
    from .replay import log_comparison as log_comparison

_PLACES = {
    "RerunObserver": ("recordings.observer", "RerunObserver"),
    "log_comparison": ("recordings.replay", "log_comparison"),
    "read_rrd": ("recordings.read", "read_rrd"),
}
"""Module of each public name, and its name there."""
__all__ = [
    "RerunObserver",
    "log_comparison",
    "read_rrd",
]

if not TYPE_CHECKING:  # a type checker that saw them would accept any name
    __getattr__, __dir__ = loaders_of(__name__, _PLACES)
