"""Grammar of sentences that programs write: articles and plurals."""


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
