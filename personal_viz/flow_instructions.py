"""What participants are told before they begin: the study's own text, then task, keys and map, with pictures."""

import base64
import functools
from collections.abc import Sequence
from dataclasses import dataclass

from human_study.study import Condition, StudyConfig
from sim.types import TaskKind

from .flow_markdown import html_from_markdown, title_of
from .page_script import STATIC

WELCOME: dict[TaskKind, str] = {
    "pan": (
        "You steer a small robot through a home that you do not know. A text says who owns what; above it stands "
        "what to find.\nWalk to that object and press STOP when you stand within one metre of it. You have {steps} "
        "steps. Keys: W or Up walks 25 cm, A and D (or Left and Right) turn 30 degrees, Enter twice stops."
    ),
    "pog": (
        "You see a home from outside, without its ceiling. A text says who owns what; the line above it says what to "
        "find.\nTurn and zoom the home, click the object, and confirm your mark. You can move the mark as often as you "
        "like before you confirm."
    ),
}
"""The whole instructions where a study has no other page before its trials."""
_PAN_TASK = """
{picture}
<p>You steer a small robot through a home that you have not been in. The large picture is what the robot sees. On the
right stand <strong>what to find</strong> and, below it, a <strong>text about the people</strong> who live there and
what belongs to whom.</p>
<p>There may be several things of the same kind. Only the one that the text gives to the right person counts.</p>
<p>When the robot stands <strong>within one metre</strong> of that object, press <strong>STOP</strong>. You have
{steps} steps for each search.</p>
"""
_PAN_KEYS = """
<p><kbd>W</kbd> or <kbd>&uarr;</kbd>&ensp;walks 25 cm forward<br>
<kbd>A</kbd> or <kbd>&larr;</kbd>&ensp;turns 30 degrees left<br>
<kbd>D</kbd> or <kbd>&rarr;</kbd>&ensp;turns 30 degrees right<br>{look}
<kbd>Enter</kbd> twice&ensp;stops and gives your answer</p>
<p>One press is one step; holding a key down does nothing more. The same buttons stand on the right, for the mouse or a
touch screen. Below them, <strong>Keys</strong> lets you choose other keys and <strong>Larger text</strong> makes
everything easier to read.</p>
<p>If you cannot find the object, <strong>Give up this search</strong> ends it. Please look well before you do.</p>
"""
_LOOK_KEYS = "\n<kbd>R</kbd> and <kbd>F</kbd>&ensp;look up and down<br>"
_POG_TASK = """
{picture}
<p>You see a home from outside, without its ceiling. On the right stand <strong>what to find</strong> and, below it, a
<strong>text about the people</strong> who live there and what belongs to whom.</p>
<p>There may be several things of the same kind. Only the one that the text gives to the right person counts.</p>
<p><strong>Click that object</strong>: a mark appears. Click again to move it. When you are content, press
<strong>Confirm the mark</strong>.</p>
"""
_POG_KEYS = """
<ul><li><strong>Turn</strong> the home: drag with the left mouse button.</li>
<li><strong>Move</strong> it: drag with the right mouse button.</li>
<li><strong>Zoom</strong>: scroll.</li>
<li><strong>Another storey</strong>: press its button on the right.</li></ul>
"""
_MAP_TASK = """
{picture}
<p>You see a <strong>map of a home</strong>: the home from straight above. On the right stand <strong>what to
find</strong> and, below it, a <strong>text about the people</strong> who live there and what belongs to whom.</p>
<p>There may be several things of the same kind. Only the one that the text gives to the right person counts.</p>
<p><strong>Click that object</strong>: a mark appears. Click again to move it. When you are content, press
<strong>Confirm the mark</strong>.</p>
"""
_MAP_KEYS = """
<ul><li><strong>Move</strong> the map: drag with the right mouse button.</li>
<li><strong>Zoom</strong>: scroll.</li>
<li><strong>Another storey</strong>: press its button on the right.</li></ul>
"""
_LAST_KEYS = """
<p>Below the buttons, <strong>Larger text</strong> makes everything easier to read. If you cannot find the object,
<strong>Give up this search</strong> ends it. Please look well before you do.</p>
"""
_CONDITIONS: dict[Condition, str] = {
    "none": "<p>{some}you begin without having seen the home.</p>",
    "topdown": "<p>{some}you first see a <strong>map of the home from above</strong>{limit}. Try to remember where "
    "things stand: the map is gone when the robot starts.</p>",
    "glb": "<p>{some}you first see the <strong>home in 3-D from outside</strong>{limit}. Turn and zoom it and try to "
    "remember where things stand: it is gone when the robot starts.</p>",
    "map_first": "<p>{some}you first <strong>look at the home alone</strong>{limit}, without knowing what to find. "
    "The text comes after that.</p>",
    "map_open": "<p>{some}home and text are there from the start.</p>",
    "map_2d": "<p>{some}you do not see the home in 3-D but as a <strong>map from above</strong>; click the object "
    "there.</p>",
}
_PICTURES: dict[Condition, tuple[str, str]] = {
    "none": ("how-pan.jpg", "The page while you walk"),
    "topdown": ("how-topdown.jpg", "The page with the map of a home, before you walk in it"),
    "glb": ("how-glb.jpg", "The page with a home in 3-D, before you walk in it"),
    "map_open": ("how-pog.jpg", "The page with a home in 3-D, beside it what to find"),
    "map_first": ("how-map-first.jpg", "The page with a home in 3-D, before you are told what to find"),
    "map_2d": ("how-map-2d.jpg", "The page with the map of a home, beside it what to find"),
}
"""File in `static` and what it shows, by condition; made by screenshots_instructions.py."""
_GOOD_TO_KNOW = """
<ul><li>There is one answer to each search, and it cannot be changed afterwards. You will not be told whether it was
right.</li>
<li>Everything you do is stored at once. If the page closes or the connection breaks, open your link again: you go on
where you were.</li>
<li>Use one tab or window only: the newest one counts.</li>{breaks}
<li>You can stop taking part at any time: <strong>Leave the study</strong>, below the buttons.</li></ul>
"""


@dataclass(frozen=True, slots=True)
class InstructionPage:
    """One page to read."""

    title: str
    body: str
    """HTML."""


def instruction_pages(
    config: StudyConfig, task: TaskKind, conditions: Sequence[Condition], *, text: str
) -> tuple[InstructionPage, ...]:
    """The pages for somebody who does this task under these conditions.

    Args:
        config: The study.
        task: What the participant does.
        conditions: All that the participant will meet, in any order.
        text: The study's `instructions.md`; empty = it has nothing to add.
    """
    pages = []
    if text.strip():
        pages.append(InstructionPage(title_of(text, otherwise="About this study"), html_from_markdown(text)))
    if task == "pan":
        look = _LOOK_KEYS if config.actions == "paper6" else ""
        pages.append(InstructionPage("Your task", _PAN_TASK.format(picture=_picture("none"), steps=config.steps)))
        pages.append(InstructionPage("How to move", _PAN_KEYS.format(look=look)))
    elif set(conditions) == {"map_2d"}:
        pages.append(InstructionPage("Your task", _MAP_TASK.format(picture=_picture("map_2d"))))
        pages.append(InstructionPage("How to look around", _MAP_KEYS + _LAST_KEYS))
    else:
        pages.append(InstructionPage("Your task", _POG_TASK.format(picture=_picture("map_open"))))
        pages.append(InstructionPage("How to look around", _POG_KEYS + _LAST_KEYS))
    shown = conditions_html(config, conditions)
    if "<img" in shown:
        pages.append(InstructionPage("What you see of a home", shown))
        shown = ""
    breaks = ""
    if config.breaks.every is not None:
        breaks = f"\n<li>You can rest after every {config.breaks.every} searches.</li>"
    pages.append(InstructionPage("Good to know", shown + _GOOD_TO_KNOW.format(breaks=breaks)))
    return tuple(pages)


def conditions_html(config: StudyConfig, conditions: Sequence[Condition]) -> str:
    """What is shown of a home before or beside the task, in words and pictures; '' = the page of the task says it."""
    known: list[Condition] = [condition for condition in _CONDITIONS if condition in conditions]
    if known in (["none"], ["map_open"], ["map_2d"]):
        return ""
    some = "Sometimes " if len(known) > 1 else "Before each search "
    texts = []
    for condition in known:
        longest = config.pog.look_max_s if condition == "map_first" else config.memory.max_s
        limit = "" if longest is None else f", for {_duration(longest)} at most"
        texts.append(_CONDITIONS[condition].format(some=some, limit=limit))
        if condition not in ("none", "map_open"):
            texts.append(_picture(condition))
    return "".join(texts)


def picture_name(condition: Condition) -> str:
    """The file in `static` that shows a condition."""
    return _PICTURES[condition][0]


def _picture(condition: Condition) -> str:
    return picture_html(*_PICTURES[condition])


@functools.cache
def picture_html(name: str, alt: str) -> str:
    """A picture of `static` inside the page."""
    data = base64.b64encode((STATIC / name).read_bytes()).decode()
    return f'<img src="data:image/jpeg;base64,{data}" alt="{alt}">'


def _duration(seconds: float) -> str:
    if seconds >= 120 and seconds % 60 == 0:
        return f"{seconds / 60:.0f} minutes"
    return "one minute" if seconds == 60 else f"{seconds:.0f} seconds"
