"""The thing that a query names: its head noun, compared with categories and with the 80 classes of COCO.

Detectors of a closed list of classes, and the oracle that imitates them, find a described thing by this noun alone.
"""

import re

from sim.errors import AgentError
from sim.words.places import RELATIONS
from sim.words.synonyms import ALSO_CALLED, ONE_NAME

COCO = (
    "person", "bicycle", "car", "motorcycle", "airplane", "bus", "train", "truck", "boat", "traffic light",
    "fire hydrant", "stop sign", "parking meter", "bench", "bird", "cat", "dog", "horse", "sheep", "cow", "elephant",
    "bear", "zebra", "giraffe", "backpack", "umbrella", "handbag", "tie", "suitcase", "frisbee", "skis", "snowboard",
    "sports ball", "kite", "baseball bat", "baseball glove", "skateboard", "surfboard", "tennis racket", "bottle",
    "wine glass", "cup", "fork", "knife", "spoon", "bowl", "banana", "apple", "sandwich", "orange", "broccoli",
    "carrot", "hot dog", "pizza", "donut", "cake", "chair", "couch", "potted plant", "bed", "dining table", "toilet",
    "tv", "laptop", "mouse", "remote", "keyboard", "cell phone", "microwave", "oven", "toaster", "sink",
    "refrigerator", "book", "clock", "vase", "scissors", "teddy bear", "hair drier", "toothbrush",
)  # fmt: skip
"""The classes of detectors that were trained on COCO, in the order of their outputs."""
_ENDS = RELATIONS | {"with", "of", "that", "and", "for", "has", "having", "to", "from"}
"""Words after which a query is about something else, or about a part of its thing."""
_MOST_WORDS = 2
"""Longest name of a class, in words."""


def checked_query(text: str, detector: str) -> str:
    """The query without outer spaces.

    Raises:
        AgentError: It has no words.
    """
    query = text.strip().rstrip(".").strip()
    if not query:
        raise AgentError(f"detector {detector!r}: query is {text!r}; expected words. Say what to find.")
    return query


def require_query(query: str, detector: str) -> None:
    """Refuses to detect before there is a query.

    Raises:
        AgentError: There is none.
    """
    if not query:
        raise AgentError(f"detector {detector!r}: has no query; expected set_query() first. Say what to find.")


def coco_class(query: str) -> str | None:
    """The class of COCO that the query's head noun names, by synonyms too; None where there is none.

    A whole name wins over the last word of a longer one: "table" names "dining table", since COCO has no other.
    """
    nouns = _names(query)
    for number in range(min(len(nouns), _MOST_WORDS), 0, -1):
        ending = " ".join(nouns[-number:])
        for name in _also(ending) if number == 1 else (ending,):
            if name in COCO:
                return name
    last = _also(nouns[-1]) if nouns else ()
    return next((name for word in last for name in COCO if name.split()[-1] == word), None)


def names_category(query: str, category: str) -> bool:
    """Whether the query's head noun is the category's name, or a synonym of it: "red sofa by the door", "couch"."""
    wanted = _names(category.replace("_", " "))
    nouns = _names(query)
    if not wanted or len(nouns) < len(wanted):
        return False
    return nouns[-len(wanted) : -1] == wanted[:-1] and wanted[-1] in _also(nouns[-1])


def is_category(query: str, category: str) -> bool:
    """Whether the query says nothing but the category: "a couch", "couch"."""
    return names_category(query, category) and len(_names(query)) == len(_names(category.replace("_", " ")))


def _names(text: str) -> list[str]:
    """The words up to the first that leads to something else, without articles."""
    found: list[str] = []
    for word in re.findall(r"[a-z]+", text.lower()):
        if word in _ENDS and found:
            break
        if word not in ("a", "an", "the"):
            found.append(word)
    return found


def _also(word: str) -> tuple[str, ...]:
    """The word, its singular and its synonyms."""
    singular = next((word[: -len(end)] for end in ("es", "s") if word.endswith(end) and len(word) > 4), word)
    words = (word, word[:-1] if word.endswith("s") else word, singular)
    others = [other for name in words for other in (ONE_NAME.get(name, name), *ALSO_CALLED.get(name, ()))]
    return tuple(dict.fromkeys((*words, *others)))
