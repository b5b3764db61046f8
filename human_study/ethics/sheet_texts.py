"""Texts that a new study begins with: consent and instructions, Markdown in plain English, to be edited before `plan`.

What they say about stored data is what the program does; whoever changes the one changes the other. `{name}` is filled
in by `ethics.consent_text` and `ethics.instructions_text`. No HTML in here: pages show these texts as MDX.
"""

from sim.types import SuccessRule, TaskKind

from ..study import PanCondition, PogCondition

PAN_HEADING = "## Steering the robot"
POG_HEADING = "## Pointing at a place"
"""`ethics.instructions_for` leaves the other task's section out by these headings."""

DEFAULT_CONSENT = """\
# Taking part in the study "{study}"

{institution} invites you to take part in a study on how people find personal objects in homes. Please read this page.
You decide freely whether you take part. You need to be at least 18 years old.

## What you will do

{what}

It takes about {minutes} minutes in all{parts}. {breaks} We know of no risk beyond that of using a computer for this
long; moving pictures of rooms make some people feel slightly unwell. Stop at once if that happens to you.

## What you get

{pay}

## What is stored

- A code such as p07 that stands for you, and when you reached each part of the study.
- Whether you agreed to this page, and which version of it you read.
- What you do in each task: keys, buttons and clicks, the way of the robot, where you look from in a 3-D home, the time
  of each, and whether the page was in the background.{confidence}
- Of your browser: the size of its window (rounded) and the density of its pixels, whether it can show 3-D pictures and
  has a keyboard or a touch screen, and which keys you choose.
- What you answer in the quiz about the rules.

{not_stored}

What you do in the tasks is stored encrypted, with a key of your own. The records stay on the computer that runs the
study and in its backups, where only the people who run the study can read them. Tables made from the records carry new
codes and no dates; they may be published and then stay public. {retention}

## Stopping and withdrawing

You can stop at any time, without a reason and without any disadvantage. To take a break, close the page; your link
brings you back {back}. Closing the page is *not* a withdrawal: what you have done until then is kept and used.

To withdraw, press the button *Leave the study*. {withdraw}

## Questions

Contact: {contact}. Ethics approval: {irb}.

## Your decision

If you agree, you confirm that you have read this page, that you are at least 18 years old, and that you take part
freely. If you do not agree, only that answer, its time and the check of your browser are stored, and the study
ends here.
"""

WHAT_TEXTS: dict[TaskKind, str] = {
    "pan": "You steer a small robot through pictures of a home, with a few keys or buttons, and stop it at an object "
    "that a text describes.",
    "pog": "You see a home from above or from all sides on your screen and mark the object that a text describes.",
}

CONFIDENCE_STORED = " After each task, how sure you say you are."

NOT_STORED = """\
**Not** stored are your name, your e-mail address, your internet (IP) address, and the name or version of your
browser. Your IP address reaches the computer that runs the study while you are connected, as on every web page; it is
not written down."""

PLATFORM_HASHED = """ Your id on the recruiting platform is turned into a code that cannot be turned back without a key
of this study; the code keeps you from taking part twice."""

PLATFORM_DROPPED = " The id itself is not stored."

PLATFORM_KEPT = """ The id itself is kept in a file apart from your records; it is used only to pay you and is deleted
after that."""

WITHDRAW_TEXTS = {
    "delete": """\
The key that your records are encrypted with is then deleted, so that nobody can read what you did, not even in a
backup. What remains is your code, when you reached each part of the study, what the check of your browser found, which
keys you chose and which questions about the rules you got wrong, your consent and your withdrawal, and for each task
you had begun that it took place, how it ended, how many events of which kind (a key, a click) it had and when the
server received them, never their content.{platform} Tables that were published before you withdrew cannot be called
back.""",
    "keep": """\
You will be asked for nothing more. What you have done until then is kept and used as described above.""",
}
"""By `privacy.on_withdraw`."""
REMAINS_OF_PLATFORM = (
    " A code made of your id on the recruiting platform remains too; it cannot be turned back into the id without the"
    " study's own key."
)

BREAK_RULE = "A break is offered after every {every} searches."

DEFAULT_INSTRUCTIONS = """\
# How the study works

You will look for objects in homes. Each search comes with two texts: a **question** that says which object to find,
such as *Find Mira's reading chair*, and a **description** of who lives in the home and what belongs to whom. The
question alone is often not enough: read the description to find out which object is meant. If several objects fit,
any of them is right.

{sections}## Rules for everybody

- There is no feedback: you will not be told whether an answer was right. Please decide as well as you can.
- {hurry}
- If you cannot find the object, press *Give up this search* twice. That counts as not found; the next search follows.
- Please work alone, without help from other people or programs, and in one tab only: when you open the study again
  elsewhere, the newest page goes on and the older one turns grey.
- If the connection breaks, open your link again. Within {resume} the same search goes on where it was; after that, the
  next one begins.
- {breaks}
- Every button can also be reached with the Tab key and pressed with the space bar.

{next}
"""

QUIZ_TEXT = "Some questions about these rules come next."

PRACTICE_TEXT = "Before the first real search you can practise; practice is never counted."

CHECKS_TEXT = "A few of the later searches are easy on purpose and show whether somebody is paying attention."

PAN_SECTION = (
    PAN_HEADING
    + """

You see what the camera of a small robot sees. Drive the robot to the object and stop it there.

| Key | Button | What the robot does |
|---|---|---|
| W or Up | Forward | moves {move} forward, unless something is in the way |
| A or Left | Turn left | turns {turn} to the left on the spot |
| D or Right | Turn right | turns {turn} to the right on the spot |
{look_rows}| Enter, twice within {stop_s} seconds | STOP here, twice | stops: this is your answer, and the search ends |

You can choose other keys with the button *Keys*. One press is one step; holding a key down does nothing more.
{radius} Only a STOP counts: whoever reaches the object and does not stop has not found it. A search also ends after
{steps} steps{pan_limit}. The shorter your way, the better; turning, waiting and thinking cost no way.
{memory}
"""
)

LOOK_ROWS = """\
| R | Look up | tilts the camera up |
| F | Look down | tilts the camera down |
"""

RADIUS_TEXTS: dict[SuccessRule, str] = {
    "paper": "You have found the object when you stop **within {metres} metre of its middle**, measured along the "
    "floor on the same storey; the robot need not look at it.",
    "habitat": "You have found the object when you stop **close to it, at a place from which it is in plain view**, on "
    "the same storey; the robot need not look at it.",
    "authors": "You have found the object when you stop **close to it, at a place from which it is in plain view**.",
    "paper-strict": "You have found the object when you stop **within {metres} metre of its middle**, measured "
    "along the floor on the same storey; the robot need not look at it.",
}
"""By `success`."""

MEMORY_TEXTS: dict[PanCondition, str] = {
    "none": "",
    "topdown": "Before some searches you see a **map of the home from above**, without the text, for {look}. Remember "
    "what you can: the map does not come back.",
    "glb": "Before some searches you can look around a **3-D model of the home**, without the text, for {look}. "
    "Remember what you can: the model does not come back.",
}

POG_SECTION = (
    POG_HEADING
    + """

{conditions}

{moving}Click the object to mark it, click elsewhere to move the mark, and press *Confirm the mark* when you are sure:
that is your answer, and the search ends. Your answer is right when the mark is **within {radius} of the object's
middle**, measured along the floor on the same storey. A home with several storeys has a button for each of
them.{limit}

"""
)

POG_MOVING = "Drag to turn the home, scroll to come closer, and drag with the right button to shift it. "

POG_CONDITION_TEXTS: dict[PogCondition, str] = {
    "map_first": "First look at the home freely for {look}; there is no text yet. Then question and description appear "
    "beside it.",
    "map_open": "The home, the question and the description are on the screen together from the start.",
    "map_2d": "You see the home as a flat map from above, the one that the robot itself would draw, with question and "
    "description beside it.",
}
