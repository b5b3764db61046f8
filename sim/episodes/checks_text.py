"""Checks of the words of a dataset: owners, ownership sentences, captions, queries (DATA_FORMAT.md section 8)."""

import itertools
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator

from sim.errors import DatasetError

from .ownership import (
    OwnershipEdge,
    anonymous_summary,
    graph_from_sentences,
    normalise_phrase,
    parse_ownership,
    queries_for,
)
from .schema import Episode, EpisodeRecord
from .survey import Find, Hit, Rule, Survey, splits_in_order

_PLACEHOLDER = re.compile(r"<\s*person\w*\s*>|\bperson_?\d+\b", re.IGNORECASE)
_NOTE = re.compile(r"\b(?:nota|note|n\.?b|todo)\s*:", re.IGNORECASE)
_ROOM_TAIL = re.compile(r" in (?:the )?[^.,]+\.?$")
# Words after which a phrase is about other things ("a sofa near the lamp").
_AFTER_HEAD = re.compile(r"\b(?:near|next|located|on)\b")
_SHORT_CAPTION = 5
_PRIVATE_SPLITS = ("easy", "medium")
"""Splits in which every object has one owner (paper: c_j = 1)."""


def head_of(phrase: str) -> str:
    """The part of a phrase that is about the object itself, before "near", "next", "located" or "on"."""
    return _AFTER_HEAD.split(phrase, maxsplit=1)[0]


def is_annotator_note(caption: str) -> bool:
    """Whether a caption holds a remark of its annotator ("NOTA: ...") instead of, or after, a description."""
    return _NOTE.search(caption) is not None


def _episodes_where(is_hit: Callable[[Episode], bool]) -> Find:
    """A finder of the episodes for which `is_hit` is true."""
    return lambda survey: (Hit((e.key.split,), str(e.key)) for e in survey.records if is_hit(e))


def _records_where(is_hit: Callable[[EpisodeRecord], bool]) -> Find:
    return _episodes_where(lambda episode: is_hit(episode.record))


def _sentences_where(is_hit: Callable[[str], bool]) -> Find:
    """A finder of ownership sentences; one hit per episode, counting its sentences."""

    def find(survey: Survey) -> Iterator[Hit]:
        for episode in survey.records:
            count = sum(map(is_hit, episode.record.extracted_summary))
            if count:
                yield Hit((episode.key.split,), str(episode.key), count)

    return find


def _sound_sentences(record: EpisodeRecord) -> tuple[str, ...]:
    """The ownership sentences that can be parsed; the others count as problems of the file (row 2)."""
    return tuple(filter(_is_sound, record.extracted_summary))


def _is_sound(sentence: str) -> bool:
    try:
        parse_ownership(sentence)
    except DatasetError:
        return False
    return True


def _edges(record: EpisodeRecord) -> tuple[OwnershipEdge, ...]:
    return graph_from_sentences(_sound_sentences(record)).edges


def _owner_sentences(record: EpisodeRecord) -> list[str]:
    """The query's object, lower case, without its owner's name."""
    start = f"{record.owner} owns "
    return [text.removeprefix(start).lower() for text in record.extracted_summary if text.startswith(start)]


def _has_word(text: str, word: str) -> bool:
    return re.search(rf"\b{re.escape(word)}\b", text) is not None


def _raw_names(record: EpisodeRecord) -> set[str]:
    return {name.rpartition("_")[0] for name in record.object_names}


def _first_slots(record: EpisodeRecord) -> list[str]:
    """The first caption slot of each object; "" where it is empty."""
    slots_per_object = (record.captions,) if isinstance(record.object_id, str) else record.captions
    return [str(slots[0]).strip() if slots else "" for slots in slots_per_object]


def _objects_with_short_caption(survey: Survey) -> Iterator[Hit]:
    splits_of: dict[str, list] = defaultdict(list)
    for episode in survey.records:
        for name, caption in zip(episode.record.object_names, _first_slots(episode.record), strict=True):
            if len(caption.split()) < _SHORT_CAPTION:
                splits_of[f"{episode.key.scene}/{name}"].append(episode.key.split)
    return (Hit(splits_in_order(splits), name) for name, splits in splits_of.items())


def _names_without_edge(survey: Survey) -> Iterator[Hit]:
    """Episodes whose summary mentions a person known from elsewhere in the dataset, who owns nothing here."""
    everybody = {edge.owner for episode in survey.records for edge in _edges(episode.record)}
    for episode in survey.records:
        owners = {edge.owner for edge in _edges(episode.record)}
        mentioned = set(re.findall(r"\b\w+\b", episode.record.summary)) & everybody
        if mentioned - owners:
            yield Hit((episode.key.split,), str(episode.key))


def _lacks_category_word(record: EpisodeRecord) -> bool:
    """Whether the owner's sentences contain no long word of the category (singular; all words if none is long)."""
    words = [word for word in record.object_category.lower().split() if len(word) > 3]
    words = words or record.object_category.lower().split()
    text = " ".join(_owner_sentences(record))
    return not any(word.rstrip("s") in text for word in words)


def _owner_lacks_target(record: EpisodeRecord) -> bool:
    """Whether the text gives the target only to other people.

    True when the owner's sentences do not name the category and somebody else's sentence fits a caption of the target
    better than all of the owner's sentences do (shared words over all words).
    """
    if not _lacks_category_word(record):
        return False
    captions = [set(normalise_phrase(text).split()) for texts in record.captions_per_object for text in texts]
    mine: list[float] = [0.0]
    others: list[float] = [0.0]
    edges = _edges(record)
    my_nodes = {edge.node for edge in edges if edge.owner == record.owner}
    for edge in edges:
        words = set(normalise_phrase(edge.phrase).split())
        fit = max((len(words & caption) / len(words | caption) for caption in captions if caption), default=0.0)
        (mine if edge.node in my_nodes else others).append(fit)
    return max(others) > max(mine)


def _has_private_sentence_twice(episode: Episode) -> bool:
    """Whether two people have the same ownership sentence in a split without shared objects: two objects, one text."""
    if episode.key.split not in _PRIVATE_SPLITS:
        return False
    return any(count > 1 for count in Counter(edge.node for edge in _edges(episode.record)).values())


def _has_rival_sentence(record: EpisodeRecord) -> bool:
    """Whether there is one target, but the category's word heads two of the owner's sentences."""
    if len(record.object_names) > 1:
        return False
    category = re.compile(rf"\b{re.escape(record.object_category.lower())}s?\b")
    return sum(category.search(head_of(text)) is not None for text in _owner_sentences(record)) > 1


def _is_query_unknown(record: EpisodeRecord) -> bool:
    """Whether the queries differ from the six known sentences about "<owner>'s <category>"."""
    one_of = len(record.object_names) > 1
    return tuple(record.query) != queries_for(record.owner, record.object_category, one_of=one_of)


def _has_prefix_names(record: EpisodeRecord) -> bool:
    owners = sorted({edge.owner for edge in _edges(record)})
    return any(longer.startswith(shorter) for shorter, longer in itertools.pairwise(owners))


def _repeated_ids(survey: Survey) -> Iterator[Hit]:
    uses = Counter((episode.key.split, episode.key.episode_id) for episode in survey.records)
    for episode in survey.records:
        if uses[(episode.key.split, episode.key.episode_id)] > 1:
            yield Hit((episode.key.split,), str(episode.key))


def _ids_in_several_splits(survey: Survey) -> Iterator[Hit]:
    splits_of: dict[str, set] = defaultdict(set)
    for episode in survey.records:
        splits_of[episode.key.episode_id].add(episode.key.split)
    return (Hit(splits_in_order(splits), name) for name, splits in splits_of.items() if len(splits) > 1)


def _sampled_twice(survey: Survey) -> Iterable[Hit]:
    """Episodes with the same story, person and object as an earlier one."""
    seen: set[tuple] = set()
    for episode in survey.records:
        edges = _edges(episode.record)
        if not edges:
            continue
        sound = episode.record.model_copy(update={"extracted_summary": _sound_sentences(episode.record)})
        text, slots = anonymous_summary(sound)
        asked = (
            episode.key.split,
            episode.key.scene,
            text,
            slots.get(episode.record.owner),
            episode.record.object_names,
        )
        if asked in seen:
            yield Hit((episode.key.split,), str(episode.key))
        seen.add(asked)


TEXT_RULES = (
    Rule(9, "several-right-objects", "note", "episodes", "the query asks for one of several right objects",
         _records_where(lambda record: len(record.object_names) > 1)),
    Rule(10, "raw-name-differs-from-category", "note", "episodes", "an object's raw name is not its category",
         _records_where(lambda record: _raw_names(record) != {record.object_category})),
    Rule(11, "caption-missing", "defect", "episodes", "an object's first caption slot is empty",
         _records_where(lambda record: not all(_first_slots(record)))),
    Rule(12, "caption-is-annotator-note", "defect", "episodes", "a caption holds an annotator's note",
         _records_where(lambda record: any(map(is_annotator_note, _first_slots(record))))),
    Rule(13, "caption-short", "note", "objects", f"a caption has fewer than {_SHORT_CAPTION} words",
         _objects_with_short_caption),
    Rule(14, "owner-absent", "error", "episodes", "the asked person is not in the summary or owns nothing",
         _records_where(lambda record: not _has_word(record.summary, record.owner) or not _owner_sentences(record))),
    Rule(15, "placeholder-left", "defect", "episodes", "a <person1> was not replaced by a name",
         _records_where(lambda record: any(map(_PLACEHOLDER.search, (record.summary, *record.extracted_summary))))),
    Rule(16, "name-without-sentence", "defect", "episodes", "the summary names a person without ownership sentence",
         _names_without_edge),
    Rule(17, "owner-lacks-target", "defect", "episodes", "the text gives the target to other people only (heuristic)",
         _records_where(_owner_lacks_target)),
    Rule(18, "sentence-repeated", "defect", "episodes", "an ownership sentence appears twice",
         _records_where(lambda record: len(set(record.extracted_summary)) < len(record.extracted_summary))),
    Rule(19, "two-objects-one-sentence", "defect", "episodes", "two people's own objects have the same sentence",
         _episodes_where(_has_private_sentence_twice)),
    Rule(20, "category-word-missing", "note", "episodes", "the owner's sentences never use the category's word",
         _records_where(_lacks_category_word)),
    Rule(21, "rival-sentence", "defect", "episodes", "two of the owner's sentences fit the query (heuristic)",
         _records_where(_has_rival_sentence)),
    Rule(22, "sentence-period-at-end", "note", "sentences", "an ownership sentence ends with a period",
         _sentences_where(lambda text: text.rstrip().endswith(".")),
         also=(("sentence-period-inside", "sentences", _sentences_where(lambda text: "." in text.rstrip(" ."))),)),
    Rule(23, "sentence-without-room-tail", "note", "sentences", 'a sentence does not end with "in [the] <room>"',
         _sentences_where(lambda text: _ROOM_TAIL.search(text) is None),
         also=(("sentence-without-room", "sentences", _sentences_where(lambda text: " in " not in text)),)),
    Rule(24, "sentence-says-floor", "note", "sentences", 'a sentence holds the word "floor"',
         _sentences_where(lambda text: "floor" in text.lower())),
    Rule(25, "query-unknown", "defect", "episodes", "a query is none of the six known sentences",
         _records_where(_is_query_unknown),
         also=(("query-naive-plural", "episodes", _records_where(lambda record: len(record.object_names) > 1)),)),
    Rule(26, "episode-id-repeated", "defect", "episodes", "an episode_id is used twice in one split",
         _repeated_ids,
         also=(("episode-id-in-several-splits", "episode ids", _ids_in_several_splits),)),
    Rule(27, "name-prefix-of-name", "note", "episodes", "a person's name begins another person's name",
         _records_where(_has_prefix_names)),
    Rule(28, "summary-not-ascii", "note", "episodes", "the summary has typographic characters",
         _records_where(lambda record: not record.summary.isascii())),
    Rule(44, "sampled-twice", "defect", "episodes", "the same person and object of one story are asked for twice",
         _sampled_twice),
)  # fmt: skip
