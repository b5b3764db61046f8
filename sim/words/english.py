"""Parts of sentences that programs write: articles, counts, lengths, durations and sizes in words."""

import math


def with_article(phrase: str) -> str:
    """ "a green armchair", "an oak desk"."""
    return f"{'an' if phrase[0] in 'aeiou' else 'a'} {phrase}"


def how_many(count: float, thing: str, things: str = "") -> str:
    """ "1 home", "1,200 episodes", "0.5 seconds".

    Args:
        count: How many there are.
        thing: One of them.
        things: Several of them; by default with an "s".
    """
    number = f"{count:,}" if isinstance(count, int) else f"{count:g}"
    return f"{number} {thing if count == 1 else things or thing + 's'}"


def length(metres: float) -> str:
    """ "10 centimetres", "1.5 metres"."""
    return how_many(metres, "metre") if metres >= 1 else f"{100 * metres:g} centimetres"


def duration(seconds: float) -> str:
    """ "45 seconds", "2 minutes": in minutes where these are whole."""
    if seconds >= 60 and seconds % 60 == 0:
        return how_many(round(seconds / 60), "minute")
    return how_many(seconds, "second")


def countdown(seconds: int) -> str:
    """ "45 seconds", "2:05 minutes": for a clock that changes every second."""
    return f"{seconds // 60}:{seconds % 60:02d} minutes" if seconds >= 60 else how_many(seconds, "second")


def waiting_time(seconds: float) -> str:
    """ "one minute", "20 minutes", "2 hours": rounded up."""
    minutes = max(1, math.ceil(seconds / 60))
    if minutes >= 90:
        return f"{math.ceil(minutes / 60)} hours"
    return "one minute" if minutes == 1 else f"{minutes} minutes"


def age(seconds: float | None) -> str:
    """ "40 s", "3 min", "2 h", "5 d": a past time in its largest unit; a dash for never."""
    if seconds is None:
        return "–"
    for unit, length_s in (("d", 86_400), ("h", 3600), ("min", 60)):
        if seconds >= 2 * length_s:
            return f"{seconds / length_s:.0f} {unit}"
    return f"{seconds:.0f} s"


def disk_size(megabytes: int) -> str:
    """ "512 MB", "2.0 GB"."""
    return f"{megabytes / 1024:.1f} GB" if megabytes >= 1024 else f"{megabytes} MB"
