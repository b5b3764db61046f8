"""Templates of the documents for an ethics board; `{name}` is filled in by `ethics_documents`."""

from sim.types import TaskKind

from ..study import Condition

PURPOSE = """\
The study measures how well people find personal objects in homes, such as *Mira's reading chair*, from a description
of who lives there and what belongs to whom. Programs that control robots do the same tasks in the same simulated
homes. The results of people show how hard the tasks are, and how far the programs still have to go. What is measured
is the performance of people as a group; no individual is assessed, and nothing about a person is asked."""

TASKS: dict[TaskKind, str] = {
    "pan": "**Steering (PAN).** The person sees what the camera of a simulated robot sees in a home and steers the "
    "robot with {num_actions} actions ({actions}) to the object that the text describes. A search ends when the "
    "person stops the robot, gives up, or has used {steps} steps{pan_limit}. {success}",
    "pog": "**Pointing (POG).** The person sees a home on the screen and marks the object that the text describes. A "
    "search ends when the person confirms the mark or gives up{pog_limit}. It is successful when the mark is within "
    "{radius} m of the object's middle, measured on the floor plan of the same storey.",
}

SUCCESS_RULES = {
    "paper": "It is successful when the person stops the robot within {radius} m of the object's middle, measured on "
    "the floor plan of the same storey (1.5 m for the few objects that cannot be seen from within 1 m).",
    "habitat": "It is successful when the person stops the robot within 0.1 m of walking distance of a place from "
    "which the object is in view.",
    "authors": "It is successful when the robot ends within 0.2 m of a place from which the object is in view.",
    "paper-strict": "It is successful when the person stops the robot within {radius} m of the object's middle, "
    "measured on the floor plan of the same storey.",
}

CONDITIONS: dict[Condition, str] = {
    "none": "`none`: nothing of the home is shown before the search.",
    "topdown": "`topdown`: before the search, without the text, the person sees the home's map from above for "
    "{memory}.",
    "glb": "`glb`: before the search, without the text, the person looks around a 3-D model of the home for {memory}.",
    "map_first": "`map_first`: the person looks at the 3-D home without the text for {pog}; then the text appears "
    "beside it.",
    "map_open": "`map_open`: the 3-D home and the text are shown together from the start.",
    "map_2d": "`map_2d`: the person marks the object on the map from above that the robot itself would make.",
}

DESIGNS = {
    "house-once": "Each episode (a start, a text and an object in a home) is done by {raters} in each "
    "condition. Nobody meets a home twice without having been shown it, so that nobody profits from having been "
    "there before. Who does which episode is computed before the study from a random seed, and so is the order, in "
    "which neighbours are of different homes.",
    "crossed": "Every person does every episode, {raters} in each condition. People therefore meet a home "
    "several times; how often and how long a person has been in a home before is recorded with each search. The "
    "order is drawn before the study from a random seed; neighbours are of different homes.",
}

RECRUITING = {
    "local": "The researchers invite people themselves and give each a personal link.",
    "link": "The researchers publish one open link; whoever follows it takes the next free place until the study is "
    "full.",
    "prolific": "People come through the platform Prolific, which also pays them. The study shows the platform's "
    "code for having finished, for not being able to take part, or for not consenting.",
}

PROCEDURE = {
    "device": "The page checks whether the browser can show 3-D pictures, whether the window is large enough and "
    "whether keys arrive. Who cannot take part is told so and thanked.",
    "consent": "The consent form is shown. The answer is stored with a hash of the text. Who does not agree is "
    "thanked. Besides the answer only the check of the browser and the time of both are stored.",
    "instructions": "Instructions with pictures explain the task and the keys.",
    "quiz": "A short quiz checks that the rules were understood; wrong answers lead back to the instructions.",
}

PROTOCOL = """\
# Study protocol: {study}

{overview}

## 1. Purpose

{purpose}

## 2. Tasks and conditions

{tasks}

{conditions}

## 3. Design

{design}

## 4. Participants

{participants} {recruiting} Included are adults who read English and use a computer with a screen and a keyboard or a
mouse. Age and ability are not tested; people confirm that they are 18 or older when they consent. No demographic
data is asked for. {spare}

## 5. Procedure

{procedure}

There is no feedback on whether an answer was right, and nothing about the purpose is hidden from participants.

## 6. Duration and pay

{duration} Pay: {pay} Details are in time_and_pay.md.

## 7. Risks and benefits

We expect no risk beyond that of using a computer for this long. Moving pictures of rooms can cause slight nausea; the
information sheet says so and asks people to stop then. {breaks} Participants have no direct benefit besides the pay.

## 8. Voluntary participation and withdrawal

Participation is voluntary. Everybody can stop at any time without a reason and without any disadvantage, take breaks
by closing the page, and withdraw with a button. {withdrawal} Closing the page is a break and no withdrawal; the
consent form says so.

## 9. Data protection

{not_stored} What is stored, where, for how long and who sees it is listed in data_flow.md and retention.md. The
study runs on a computer of the researchers; no data is sent to third parties while it runs. Data is published under
new codes only.

## 10. Quality of the data

Every event is stored before it counts, in a database to which records can only be added and in which each record
holds a hash of the one before. All trials can be done again in the simulator, step by step, to show that the records
are what happened. {checks}

## 11. Responsible

Institution: {institution}. Contact: {contact}. Approval or exemption: {irb}.
"""

INFORMATION_SHEET = """\
# Information for participants: {study}

**Who we are.** {institution}. Contact for questions and complaints: {contact}. Ethics approval: {irb}.

**What the study is about.** Robots are to help people find their own things at home. We want to know how well people
do such a search, so that programs can be compared with them. It is not a test of you as a person.

**What you will do.** {what}

**How long it takes.** {duration} {breaks}

**What you get.** {pay}

**Who can take part.** Adults (18 or older) who read English, at a computer with a current browser.

**Risks.** There are none beyond those of using a computer for this long. Moving pictures of rooms make some people
feel slightly unwell: please stop at once if that happens to you.

**It is voluntary.** You can stop at any time without giving a reason. To withdraw, press the button *Leave the
study*. {withdrawal} Closing the page is a break and not a withdrawal: what you have done until then is kept and
used, and your link brings you back.

**Your data.** {not_stored_short} Your records carry a code and are encrypted with a key of your own. {retention}
Results are published for all participants together, and the records of single searches under new codes, without
dates.

**Your rights.** As long as the records exist you can ask us for them, or to have them deleted. We cannot tell from a
name which records are yours: keep your personal link, it is the only thing that leads to them.
"""

DATA_FLOW = """\
# Data flow: {study}

A participant's browser sends key presses, clicks and camera poses, encrypted (TLS), to one computer of the
researchers. There the study program checks each message, steps the simulator and writes the record to disk before
the next picture is shown. Only pictures (and, for pointing, the home's geometry) travel back, never an answer or a
score. The researchers make exports from the records after the study.

    browser of a participant  <-- TLS -->  [reverse proxy, no access log]  -->  study program
                                                                                  |
                                     study.db (records), keys.json (keys), secrets.json (links), backups
                                                                                  |
                                            study export: new codes, no ids  -->  analysis, publication

{not_stored}

| What is stored | Why | Where, and in which form | Who can see it | Until |
|---|---|---|---|---|
{rows}
"""

RETENTION = """\
# Retention: {study}

The records are deleted on {retention}. Deleting means: the study's folder with database, keys, links and backups is
removed from the computer that ran the study, and from backups of that computer. {withdrawal}

| Data | Kept until |
|---|---|
{rows}
"""

TIME_AND_PAY = """\
# Time and pay: {study}

{stated} The estimate is the sum of stated seconds for each part, before any pilot; the times of a pilot replace them.

| | {columns} |
|---|{rules}|
{rows}

The part of {reading} s is for the browser check, consent, instructions and quiz; a search is taken to last {pan} s
(steering) or {pog} s (pointing), a look at a map or home before it up to {look} s, a break {rest} s. Totals per
person are rounded up to {step} minutes.

{sum}

**Pay.** {pay} For the budget: all people together spend about {hours}, spare places not included. People who
withdraw or are turned away after the consent form are to be paid for the time that they spent.
"""
