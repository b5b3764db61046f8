"""Plans of earlier versions as documents of the current one; read by `load_plan`."""

import json
from typing import Any

_MATERIALS = {
    "fabric": "fabric", "velvet": "fabric", "woven": "fabric", "oak": "wood", "walnut": "wood", "wooden": "wood",
    "enamel": "metal", "ceramic": "ceramic", "paper": "paper", "painted": "picture", "framed": "picture",
}  # fmt: skip
"""Words that version 1 used as materials."""


def current(data: bytes) -> bytes:
    """The plan as a document of the current version; what is no plan of an earlier one is returned as it is."""
    try:
        plan = json.loads(data)
    except (ValueError, RecursionError):
        return data
    if not isinstance(plan, dict) or plan.get("schema_version") != 1:
        return data
    try:
        return json.dumps(_from_version_1(plan)).encode()
    except (AttributeError, TypeError):  # not a plan of version 1 either: the check of the current one says so
        return data


def _from_version_1(plan: dict[str, Any]) -> dict[str, Any]:
    rooms = [_room(room) for room in plan.get("rooms", [])]
    furniture = [_piece(piece) for piece in plan.get("furniture", [])]
    return {**plan, "schema_version": 2, "rooms": rooms, "furniture": furniture}


def _room(room: dict[str, Any]) -> dict[str, Any]:
    kept = {key: value for key, value in room.items() if key not in ("floor_rgb", "wall_rgb")}
    floor, wall = ({"material": m, "rgb": room.get(key)} for m, key in (("wood", "floor_rgb"), ("plaster", "wall_rgb")))
    return {**kept, "floor": floor, "wall": wall}


def _piece(piece: dict[str, Any]) -> dict[str, Any]:
    kept = {key: value for key, value in piece.items() if key not in ("rgb", "material")}
    material = _MATERIALS.get(piece.get("material", ""), "plastic")
    return {**kept, "finish": {"material": material, "rgb": piece.get("rgb")}}
