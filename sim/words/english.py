"""Parts of English sentences that programs write for researchers: articles, counts and sizes in words."""


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
