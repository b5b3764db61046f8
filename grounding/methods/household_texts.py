"""Ordinary texts about things in homes; a phrase that resembles a cell no more than these do is no evidence.

Written for this project, not taken from a dataset. `joint` uses their spread as the background against which a phrase
stands out.
"""

_NOUNS = ", ".join(
    (
        "armchair, backpack, bag, basket, bathtub, bed, bench, bicycle, bin, blanket, blinds, board game, book",
        "bookshelf, bottle, bowl, box, broom, bucket, cabinet, candle, carpet, chair, chandelier, chest of drawers",
        "clock, clothes rack, coat, coffee machine, coffee table, computer, couch, cup, curtain, cushion, desk",
        "dining table, dishwasher, door, doormat, dresser, fan, faucet, fireplace, floor lamp, flower pot, guitar",
        "hair dryer, hat, headboard, jacket, kettle, keyboard, kitchen counter, ladder, lamp, laptop, laundry basket",
        "magazine, mattress, microwave, mirror, monitor, nightstand, ottoman, oven, painting, photo frame, piano",
        "picture, pillow, plant, plate, poster, printer, radiator, refrigerator, rug, sculpture, shelf, shoe rack",
        "shower curtain, side table, sink, sofa, speaker, staircase, statue, stool, stove, suitcase, table, table lamp",
        "teddy bear, telephone, television, toaster, toilet, towel, toy, trash can, tray, treadmill, tv stand",
        "umbrella, vacuum cleaner, vase, wardrobe, washing machine, window, wine rack",
    )
).split(", ")
_SIZES = ("small", "large", "tall", "round", "rectangular", "old", "modern")
_COLOURS = ("white", "black", "grey", "brown", "beige", "red", "blue", "green", "yellow", "golden", "dark", "light")
_MATERIALS = ("wooden", "metal", "glass", "leather", "fabric", "plastic", "ceramic", "stone")
_RELATIONS = ("next to", "on top of", "near", "in front of", "hanging above", "behind", "under")


def household_texts() -> tuple[str, ...]:
    """Each thing by its name, with attributes, with a relation, and with a detail: a few hundred fixed texts.

    The steps through attributes and neighbours share no factor with the lengths of their lists, which mixes all pairs.
    """
    texts = list(_NOUNS)
    for index, noun in enumerate(_NOUNS):
        size, material = _SIZES[index % len(_SIZES)], _MATERIALS[index % len(_MATERIALS)]
        texts.append(f"{size} {_COLOURS[index % len(_COLOURS)]} {material} {noun}")
        colour, relation = _COLOURS[(5 * index + 3) % len(_COLOURS)], _RELATIONS[index % len(_RELATIONS)]
        texts.append(f"{colour} {noun} {relation} the {_NOUNS[(37 * index + 11) % len(_NOUNS)]}")
        material, colour = _MATERIALS[(3 * index + 1) % len(_MATERIALS)], _COLOURS[(7 * index + 2) % len(_COLOURS)]
        texts.append(f"{material} {noun} with a {colour} {_NOUNS[(53 * index + 29) % len(_NOUNS)]}")
    return tuple(texts)
