"""Words for places: prepositions, verbs of standing somewhere, and rooms."""

from collections.abc import Mapping
from typing import Literal, get_args

UNDER = ("under", "below", "beneath", "underneath")
UPON = ("on", "above", "over", *UNDER)
PLACED = ("located", "situated", "positioned", "placed")
RELATIONS = frozenset({
    *UPON, *PLACED,
    "next", "near", "beside", "by", "close", "behind", "front", "between", "opposite", "against", "along", "around",
    "attached", "adjacent", "surrounded", "facing", "in", "inside", "containing", "contain", "at", "outside", "where",
    "which", "used", "supporting", "hanging",
})  # fmt: skip
"""Words after which a caption is about something else."""
PLACE_PHRASES = (
    *UNDER, *PLACED,
    "next to", "nest to", "near(?:by)?", "nar", "besides?", "close to", "in front", "in between", "between", "behind",
    "above", "uder", "over", "on top", "on the", "on a", "on its", "on it", "in the", "in a", "inside", "at the",
    "against", "opposite", "around", "towards?", "along", "attached", "hanging (?:on|over|near|above)", "haning",
    "hung", "lcoated", "standing", "lying", "mounted on", "facing", "to the (?:left|right)", "used for",
    "that (?:leads|goes|separates)", "there (?:is|are)", "depicting", "representing",
    "of the (?:room|bed|kitchen|bathroom|closet|stairs|living|corridor|house|table|dining|couch)",
)  # fmt: skip
"""Alternatives of a pattern for the words after which a phrase is about places and other things; with misspellings."""
ROOM_NOUN = (
    r"(?:(?:bed|bath|living|dining|laundry|tv|game|storage|sitting|family|guest|play|media|work|sun|utility|toilet)"
    r"[ -]?rooms?|kitchen|corridor|hallway|hall|entrance|entryway|foyer|studio|office|closet|staircase|stairs|garage|"
    r"terrace|balcony|basement|attic|gym|library|lounge|pantry|open[- ]space|study|landing|cellar|wardrobe room|"
    r"veranda|porch|restroom|room|area|lobby|loft|suite|wc|den|parlou?r|nook|conservatory|mezzanine|"
    r"cloakroom|nursery|dressing[ -]room)"
)
"""A pattern of the nouns for rooms in descriptions."""
RoomKind = Literal[
    "bathroom", "bedroom", "kitchen", "living room", "dining room", "closet", "hallway", "entrance", "laundry room",
    "studio", "garage", "tv room", "game room", "stairs", "attic", "utility room", "room",
]  # fmt: skip
ROOM_KINDS: tuple[RoomKind, ...] = get_args(RoomKind)

ROOM_WORDS: Mapping[str, RoomKind] = {
    "bathroom": "bathroom", "bath": "bathroom", "toilet": "bathroom", "restroom": "bathroom", "bathrom": "bathroom",
    "shower room": "bathroom", "bedroom": "bedroom", "edroom": "bedroom", "bed room": "bedroom",
    "kitchen": "kitchen", "kitchen island": "kitchen", "bar place": "kitchen",
    "living room": "living room", "living": "living room", "lounge": "living room", "relax area": "living room",
    "dining room": "dining room", "dinign room": "dining room", "dining space": "dining room", "dining": "dining room",
    "diningtable": "dining room", "closet": "closet", "closeth": "closet", "dressing room": "closet",
    "hallway": "hallway", "hall": "hallway", "corridor": "hallway", "doorway": "hallway", "open space": "living room",
    "entrance": "entrance", "entranche": "entrance", "entanche": "entrance", "foyer": "entrance",
    "laundry room": "laundry room", "laundry": "laundry room", "studio": "studio", "office": "studio",
    "study": "studio", "garage": "garage", "tv room": "tv room", "game room": "game room", "play room": "game room",
    "playroom": "game room", "gym": "game room", "staircase": "stairs", "stairs": "stairs", "stair region": "stairs",
    "stiars": "stairs", "attic": "attic", "utility room": "utility room",
}  # fmt: skip
"""The kind of room that each word means; typing errors of the release are included."""
