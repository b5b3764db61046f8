"""The up axis of a scan's file, from Habitat's own configuration files beside the scans, or from HM3D's names."""

import re
from pathlib import Path
from typing import Literal, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from sim.errors import SceneError, line_from_validation_error

Up = Literal["z", "y"]
HM3D_UP: Up = "z"
_ADVICE = "Correct the file, or remove it for HM3D's own scans, which are z-up."


class _Part(BaseModel):
    """A part of Habitat's files; only the fields that we need are checked."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)


_AnyPart = TypeVar("_AnyPart", bound=_Part)


class _Stage(_Part):
    up: tuple[float, float, float] | None = None


class _Stages(_Part):
    default_attributes: _Stage = _Stage()


class _Dataset(_Part):
    stages: _Stages = _Stages()


def up_axis(scan: Path, *, root: Path) -> Up | None:
    """The up axis that Habitat's files or HM3D's names say; None where nothing does, and then glTF means y.

    Args:
        scan: The file; `<its name>.stage_config.json` beside it counts first. Without any such file, HM3D's names mean
            z: `<Scene>.basis.glb`, or a folder `00800-<Scene>`.
        root: Last folder to search. The nearest folder from the scan upwards counts next, if it has
            `*.scene_dataset_config.json` files with a `stages.default_attributes.up`.

    Raises:
        SceneError: A file is damaged, names another axis, or two in one folder differ.
    """
    name = scan.name.split(".")[0]
    own = scan.with_name(f"{name}.stage_config.json")
    if own.is_file():
        found = _axis(own, _read(own, _Stage).up)
        if found is not None:
            return found
    for folder in scan.parents:
        files = sorted(folder.glob("*.scene_dataset_config.json"))
        ups = {path: _read(path, _Dataset).stages.default_attributes.up for path in files}
        axes: dict[Path, Up] = {path: axis for path, up in ups.items() if (axis := _axis(path, up)) is not None}
        if len(set(axes.values())) > 1:
            named = ", ".join(f"{path.name} says {axis}" for path, axis in axes.items())
            raise SceneError(f"{folder}: {named}; expected one up axis for {scan.name}. Keep one of the files.")
        if axes:
            return next(iter(axes.values()))
        if folder == root:
            break
    is_hm3d = ".basis." in scan.name or re.fullmatch(rf"\d{{5}}-{re.escape(name)}", scan.parent.name) is not None
    return HM3D_UP if is_hm3d else None


def _read(path: Path, model: type[_AnyPart]) -> _AnyPart:
    try:
        return model.model_validate_json(path.read_bytes())
    except OSError as error:
        raise SceneError(f"{path}: cannot be read ({error.strerror}); expected Habitat's JSON. {_ADVICE}") from None
    except ValidationError as error:
        raise SceneError(line_from_validation_error(str(path), error, advice=_ADVICE)) from None


def _axis(path: Path, up: tuple[float, float, float] | None) -> Up | None:
    if up is None:
        return None
    if up == (0.0, 1.0, 0.0):
        return "y"
    if up == (0.0, 0.0, 1.0):
        return "z"
    raise SceneError(f"{path}: up is {list(up)}; expected [0, 1, 0] or [0, 0, 1]. {_ADVICE}")
