"""Synonyms: one name per group to compare texts by, names that captions use, words to reword captions with.

The three tables serve three readers and stay apart: one joined table would change how released captions are read.
"""

ONE_NAME: dict[str, str] = {
    word: name
    for name, words in {
        "red": "reddish burgundy", "blue": "bluish navy", "green": "greenish", "yellow": "yellowish",
        "brown": "brownish", "grey": "gray greyish grayish", "white": "whitish", "golden": "gold", "purple": "violet",
        "black": "blackish", "pink": "pinkish", "wood": "wooden oak walnut pine",
        "metal": "metallic steel iron aluminium chrome", "stone": "marble granite brick bricks",
        "ceramic": "porcelain", "fabric": "cloth textile velvet", "wicker": "rattan straw", "paper": "cardboard",
        "striped": "stripes stripe", "plaid": "tartan", "floral": "flowery flowered", "dotted": "dots polka",
        "checked": "checkered chequered squared", "patterned": "pattern patterns geometric decorated",
        "large": "big huge wide king queen double", "small": "little tiny single mini", "tall": "high",
        "round": "circular rounded oval", "light": "pale", "couch": "sofa", "tv": "television",
        "refrigerator": "fridge", "picture": "painting", "nightstand": "bedside", "stairs": "staircase stairway stair",
        "glass": "", "clothes": "",
    }.items()
    for word in (name, *words.split())
}  # fmt: skip
"""One name for each group of synonyms, by word: texts are compared by these names."""
ALSO_CALLED: dict[str, tuple[str, ...]] = {
    "couch": ("sofa", "couches"), "sofa": ("couch",), "picture": ("painting", "photo", "poster"),
    "rug": ("carpet",), "carpet": ("rug",), "armchair": ("chair", "armachair"),
    "refrigerator": ("fridge", "refridgerator"),
    "tv": ("television",), "sink": ("washbasin", "basin"), "nightstand": ("bedside",), "bathtub": ("tub", "bath"),
    "pillow": ("cushion",), "cushion": ("pillow",), "dresser": ("chest", "drawers"), "bench": ("seat",),
    "mirror": ("mirrors",), "blanket": ("comforter", "throw"), "stair": ("stairs", "staircase"), "shelf": ("shelves",),
}  # fmt: skip
"""Other nouns that captions use for things of a category, by the last word of the category's name."""
REWORDINGS: dict[str, tuple[str, ...]] = {
    # sizes and shapes
    "small": ("little", "compact"), "little": ("small",), "tiny": ("very small",), "large": ("big", "sizeable"),
    "big": ("large", "bulky"), "huge": ("very big",), "tall": ("high",), "high": ("tall",), "low": ("short",),
    "long": ("lengthy", "elongated"), "short": ("low",), "wide": ("broad",), "broad": ("wide",), "narrow": ("slim",),
    "thin": ("slender",), "thick": ("heavy",), "round": ("circular",), "circular": ("round",), "oval": ("elliptical",),
    "square": ("four-sided",), "rectangular": ("oblong",), "l-shaped": ("angled",), "flat": ("level",),
    "double": ("two-person",), "single": ("one-person",), "king": ("extra large",),
    # colours
    "white": ("snowy", "ivory"), "black": ("ebony", "jet"), "grey": ("gray", "ash"), "gray": ("grey", "ash"),
    "brown": ("chestnut", "tan"), "red": ("crimson", "scarlet"), "blue": ("azure", "navy"), "green": ("emerald",),
    "yellow": ("lemon", "golden"), "orange": ("tangerine",), "purple": ("violet",), "pink": ("rose",),
    "beige": ("sand", "cream"), "golden": ("gilded",), "silver": ("silvery",), "dark": ("deep",), "light": ("pale",),
    "colorful": ("multicoloured",), "striped": ("banded",), "patterned": ("figured",), "plain": ("simple",),
    # materials
    "wooden": ("timber", "wood"), "wood": ("timber",), "metal": ("metallic",), "steel": ("metal",), "iron": ("metal",),
    "leather": ("hide",), "glass": ("glazed",), "plastic": ("synthetic",), "stone": ("rock",), "fabric": ("cloth",),
    "marble": ("veined stone",), "woven": ("braided",), "fur": ("fluffy",), "cushioned": ("padded",),
    # looks
    "old": ("aged",), "modern": ("contemporary",), "decorative": ("ornamental",), "decorated": ("adorned",),
    "carved": ("sculpted",), "framed": ("bordered",), "mounted": ("fixed",), "hanging": ("suspended",),
    # things nearby
    "couch": ("sofa",), "sofa": ("couch",), "rug": ("carpet",), "carpet": ("rug",), "picture": ("image",),
    "painting": ("canvas",), "tv": ("television",), "television": ("tv",), "wardrobe": ("closet",),
    "closet": ("wardrobe",), "cupboard": ("cabinet",), "cabinet": ("cupboard",), "lamp": ("light",),
    "blanket": ("throw",), "pillow": ("cushion",), "cushion": ("pillow",), "curtain": ("drape",),
    "refrigerator": ("fridge",), "fridge": ("refrigerator",), "stove": ("cooker",), "bathtub": ("bath",),
    "nightstand": ("bedside table",), "fireplace": ("hearth",), "corner": ("nook",), "window": ("pane",),
    # places
    "near": ("close to", "not far from"), "beside": ("next to", "alongside"), "next to": ("beside", "adjacent to"),
    "above": ("over", "higher than"), "over": ("above",), "below": ("beneath", "underneath"),
    "under": ("beneath", "underneath"), "in front of": ("before", "facing"), "behind": ("at the back of",),
    "between": ("amid",), "located": ("placed", "situated"), "positioned": ("placed",), "standing": ("placed",),
    "on top of": ("atop",), "with": ("having", "featuring"), "against": ("up to",), "opposite": ("across from",),
}  # fmt: skip
"""Words to reword a caption with, written for this project; they mean nearly the same, a little less exactly."""
