"""CLIP, SigLIP and BLIP-2 through the real loading code, offline, with tiny models of random weights."""

import json
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import torch
import transformers
from safetensors.torch import load_file, save_file

from grounding.checks import check_image_encoder
from grounding.encoders import by_name as encoders
from grounding.encoders.by_name import make_encoder, make_image_encoder
from grounding.encoders.packed_bert import one_thread
from grounding.encoders.protocol import Autocast, DenseEncoder, ModelOptions
from sim.errors import AgentError, MissingDependencyError
from sim.types import Frame

from .tiny_models import picture, save_blip2, save_clip, save_siglip, save_siglip_naflex


@dataclass(frozen=True)
class Kind:
    family: str
    save: Callable[..., Path]
    dim: int
    grid: tuple[int, int]
    """(rows, columns) of patches in a picture of 64 x 96 pixels."""


KINDS = {
    "clip": Kind("clip", save_clip, 24, (4, 4)),
    "siglip": Kind("siglip", save_siglip, 32, (4, 4)),
    "naflex": Kind("siglip", save_siglip_naflex, 32, (3, 5)),
    "itc256": Kind("blip2-itc256", save_blip2, 16, (2, 2)),
    "hidden768": Kind("blip2-hidden768", save_blip2, 32, (2, 2)),
}
ALL = pytest.mark.parametrize("kind", list(KINDS))


@pytest.fixture(scope="module", autouse=True)
def few_threads() -> Iterator[None]:
    """Uses one thread: tiny products are slower on several, and much slower beside other processes."""
    with one_thread():
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Gives the folder of the saved model of a kind, which is made once."""
    root, saved = tmp_path_factory.mktemp("models"), {}

    def of(kind: str) -> Path:
        if kind not in saved:
            saved[kind] = KINDS[kind].save(root / kind)
        return saved[kind]

    return of


@pytest.fixture(scope="module")
def load(folder: Callable[[str], Path]) -> Callable[..., DenseEncoder]:
    made: dict[tuple[str, str], DenseEncoder] = {}

    def of(kind: str, *, autocast: str = "off") -> DenseEncoder:
        if (kind, autocast) not in made:
            options = ModelOptions(batch_size=2, autocast=autocast)
            made[(kind, autocast)] = make_image_encoder(f"{KINDS[kind].family}:{folder(kind)}", options=options)
        return made[(kind, autocast)]

    return of


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=pytest.mark.slow if kind == "clip" else pytest.mark.release) for kind in KINDS]
)
def test_our_adapters_keep_the_contract(kind: str, load) -> None:
    assert check_image_encoder(load(kind)) == []


@ALL
def test_shapes_are_those_of_the_model(kind: str, load) -> None:
    encoder, frames = load(kind), [picture(30, 30), picture(30, 220), picture(90, 160)]
    assert encoder.dim == KINDS[kind].dim
    assert encoder.encode_texts(["red chair", "sofa", "lamp"]).shape == (3, encoder.dim)
    assert encoder.encode_images(frames).shape == (3, encoder.dim)
    assert encoder.encode_patches(frames).shape == (3, *KINDS[kind].grid, encoder.dim)


@ALL
def test_patches_are_in_the_order_of_the_picture(kind: str, load) -> None:
    patches = load(kind).encode_patches([picture(30, 220)])[0]
    left, right = patches[:, 0], patches[:, -1]
    within = (left @ left.T).mean() + (right @ right.T).mean()
    assert within > 2 * (left @ right.T).mean() + 0.2


@ALL
def test_bfloat16_changes_little(kind: str, load) -> None:
    exact, fast, frames = load(kind), load(kind, autocast="bfloat16"), [picture(30, 220)]
    pairs = [
        (exact.encode_texts(["red chair"]), fast.encode_texts(["red chair"])),
        (exact.encode_images(frames), fast.encode_images(frames)),
        (exact.encode_patches(frames), fast.encode_patches(frames)),
    ]
    for first, second in pairs:
        assert second.dtype == np.float32
        assert not np.array_equal(first, second)
        assert (first * second).sum(axis=-1).min() > 0.99
    assert exact.name == fast.name


@ALL
def test_the_same_weights_have_the_same_name_in_any_folder(kind: str, folder, load, tmp_path: Path) -> None:
    made = KINDS[kind]
    again = make_image_encoder(f"{made.family}:{made.save(tmp_path / 'copy')}")
    other = make_image_encoder(f"{made.family}:{made.save(tmp_path / 'other', seed=1)}")
    assert again.name == load(kind).name
    assert other.name != again.name
    assert other.name.split("@")[0] == again.name.split("@")[0]


CLASSES = {
    "clip": transformers.CLIPModel,
    "siglip": transformers.SiglipModel,
    "naflex": transformers.Siglip2Model,
    "itc256": transformers.Blip2ForImageTextRetrieval,
}


def squeezed(source: Path, frame: Frame, *, side: int | None = 32) -> dict[str, torch.Tensor]:
    """A picture as `transformers` resizes it to a square of `side` pixels; None = in its own proportions."""
    how = {"size": {"height": side, "width": side}, "do_center_crop": False} if side else {}
    processor = transformers.AutoImageProcessor.from_pretrained(source)
    return dict(processor([frame.rgb], return_tensors="pt", input_data_format="channels_last", **how))


@pytest.mark.parametrize("kind", list(CLASSES))
def test_vectors_equal_those_of_transformers(kind: str, folder, load) -> None:
    source, frame = folder(kind), picture(30, 220)
    model = CLASSES[kind].from_pretrained(source).eval()
    full = {"padding": "max_length", "max_length": 12, "padding_side": "right"} if kind in ("siglip", "naflex") else {}
    tokens = transformers.AutoTokenizer.from_pretrained(source)(["red chair"], return_tensors="pt", **full)
    mask = {} if full else {"attention_mask": tokens["attention_mask"]}
    with torch.inference_mode():
        said = model(
            input_ids=tokens["input_ids"],
            **mask,
            **squeezed(source, frame, side={"naflex": None, "itc256": 64}.get(kind, 32)),
        )
    text, image = said.text_embeds.numpy(), said.image_embeds.numpy()
    if kind == "itc256":  # one vector for each query token
        image = image.mean(axis=1) / np.linalg.norm(image.mean(axis=1))
    assert np.allclose(load(kind).encode_texts(["red chair"]), text, atol=1e-5)
    assert np.allclose(load(kind).encode_images([frame]), image, atol=1e-5)


def test_siglip_ignores_case_long_texts_are_cut_and_naflex_needs_pictures_of_one_size(load) -> None:
    assert np.allclose(*load("siglip").encode_texts(["Red CHAIR", "red chair"]), atol=1e-6)
    with pytest.raises(AgentError, match="frames of several sizes; expected one"):
        load("naflex").encode_patches([picture(30, 220), picture(30, 220, width=64)])
    first, second = load("clip").encode_texts(["lamp " * 30 + "sofa", "lamp " * 30 + "chair"])
    assert np.allclose(first, second, atol=1e-6)


def test_patches_of_clip_equal_the_usual_ones_if_the_last_attention_adds_nothing(folder, tmp_path: Path) -> None:
    source, frame = tmp_path / "alone", picture(30, 220)
    shutil.copytree(folder("clip"), source)
    model = transformers.CLIPModel.from_pretrained(source).eval()
    with torch.inference_mode():
        model.vision_model.encoder.layers[-1].self_attn.out_proj.weight.zero_()
        hidden = model.vision_model(**squeezed(source, frame)).last_hidden_state[:, 1:]
        usual = model.visual_projection(model.vision_model.post_layernorm(hidden))
    model.save_pretrained(source)
    expected = torch.nn.functional.normalize(usual, dim=-1).reshape(1, 4, 4, 24).numpy()
    assert np.allclose(make_image_encoder(f"clip:{source}").encode_patches([frame]), expected, atol=1e-5)


def test_the_hidden_space_of_blip2_is_the_input_of_its_projection(folder, load) -> None:
    source = folder("hidden768")
    model = transformers.Blip2ForImageTextRetrieval.from_pretrained(source).eval()
    projected: list[torch.Tensor] = []
    model.text_projection.register_forward_hook(lambda _, inputs, __: projected.append(inputs[0]))
    tokens = transformers.AutoTokenizer.from_pretrained(source)(["red chair"], return_tensors="pt")
    ids = {key: tokens[key] for key in ("input_ids", "attention_mask")}
    with torch.inference_mode():
        model(**ids, **squeezed(source, picture(30, 220), side=64))
    (states,) = projected
    first = torch.nn.functional.normalize(states.reshape(-1, states.shape[-1])[:1], dim=-1).numpy()
    assert np.allclose(load("hidden768").encode_texts(["red chair"]), first, atol=1e-5)


def test_a_text_encoder_by_name_has_the_name_of_its_model(folder, load) -> None:
    encoder = make_encoder(f"clip:{folder('clip')}")
    assert encoder.name == load("clip").name
    assert np.allclose(encoder.encode_texts(["lamp"]), load("clip").encode_texts(["lamp"]), atol=1e-6)


def test_one_loaded_model_serves_queries_and_pictures_until_other_options_are_given(folder, tmp_path: Path) -> None:
    shutil.copytree(folder("siglip"), tmp_path / "model")
    name, options = f"siglip:{tmp_path / 'model'}", ModelOptions(batch_size=2)
    eye = make_image_encoder(name, options=options)
    shutil.rmtree(tmp_path / "model")
    assert make_image_encoder(name, options=ModelOptions(batch_size=2)) is eye
    assert np.allclose(make_encoder(name, options=options).encode_texts(["sofa"]), eye.encode_texts(["sofa"]))
    with pytest.raises(AgentError, match="found no such folder"):
        make_image_encoder(name, options=ModelOptions(batch_size=3))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("clip:./nothing/here", r"found no such folder; expected one with config\.json"),
        ("siglip:/nothing/here", r"found no such folder; expected one with config\.json"),
        ("blip2-itc256:~/no such folder", r"found no such folder; expected one with config\.json"),
        ("clip:nobody/no-such-model", r"in the local cache \(downloads are off\)\. Check the id"),
        ("clip:{empty}", r"cannot be loaded \(.*expected config\.json, weights, tokenizer"),
    ],
)
def test_an_error_about_a_missing_model_says_what_to_do(name: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(AgentError, match=message):
        make_image_encoder(name.replace("{empty}", str(tmp_path)), options=ModelOptions(download=False))


def test_a_model_of_another_family_and_float16_on_the_cpu_are_refused(folder) -> None:
    with pytest.raises(AgentError, match=r"config\.json says model_type 'siglip'; expected clip"):
        make_image_encoder(f"clip:{folder('siglip')}")
    with pytest.raises(AgentError, match="expected off or bfloat16"):
        make_image_encoder(f"clip:{folder('clip')}", options=ModelOptions(autocast="float16"))


def leave_a_gap(folder: Path) -> None:
    weights = load_file(folder / "model.safetensors")
    del weights["text_projection.weight"]
    save_file(weights, folder / "model.safetensors", metadata={"format": "pt"})


def shrink(folder: Path) -> None:
    config = json.loads((folder / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps({**config, "projection_dim": 20}))


def overwrite(folder: Path) -> None:
    (folder / "model.safetensors").write_bytes(b"no weights" * 10)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (leave_a_gap, r"1 weights are missing or of another shape, first text_projection\.weight"),
        (shrink, r"\d weights are missing or of another shape, first t"),
        (overwrite, r"cannot be loaded \(Error while deserializing header"),
    ],
)
def test_damaged_weights_are_refused_instead_of_filled_at_random(damage, message: str, folder, tmp_path: Path) -> None:
    source = shutil.copytree(folder("clip"), tmp_path / "damaged")
    damage(source)
    with pytest.raises(AgentError, match=message):
        make_image_encoder(f"clip:{source}")


@pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has a GPU")
def test_a_missing_gpu_is_refused(folder) -> None:
    with pytest.raises(AgentError, match="torch sees no such device"):
        make_image_encoder(f"clip:{folder('clip')}", options=ModelOptions(device="cuda"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"device": "gpu"}, r"device 'gpu': is not known; expected cpu or cuda\. Choose"),
        ({"device": "cuda:0"}, r"device 'cuda:0': is not known; expected cpu or cuda\. Choose"),
        ({"autocast": "bf16"}, r"autocast 'bf16': is not known; expected off or bfloat16 or float16\. Choose"),
        ({"batch_size": 0}, r"batch_size 0: is too small; expected 1 or more\. Choose"),
    ],
)
def test_options_with_unknown_values_are_refused(options: dict, message: str, folder) -> None:
    with pytest.raises(AgentError, match=message):
        make_image_encoder(f"clip:{folder('clip')}", options=ModelOptions(**options))


def test_too_little_memory_says_what_to_do(monkeypatch: pytest.MonkeyPatch, load) -> None:
    def fill(*_: object, **__: object) -> None:
        raise torch.cuda.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB.")

    encoder = load("clip")
    monkeypatch.setattr(torch.nn.functional, "normalize", fill)
    with pytest.raises(AgentError, match=r"too little free memory; .* batches of 2\. Use a smaller batch"):
        encoder.encode_images([picture(30, 220)])


def test_without_transformers_the_extra_is_named(monkeypatch: pytest.MonkeyPatch, folder) -> None:
    source = f"clip:{folder('clip')}"
    encoders._model.cache_clear()
    monkeypatch.setitem(sys.modules, "transformers", None)
    with pytest.raises(MissingDependencyError, match=r"extra 'models'. Run: pip install 'personal-viz\[models\]'"):
        make_image_encoder(source)


@pytest.mark.gpu
@pytest.mark.parametrize("autocast", get_args(Autocast))
@ALL
def test_a_gpu_gives_the_same_vectors_as_the_cpu(kind: str, autocast: Autocast, folder, load) -> None:
    here, name = load(kind), f"{KINDS[kind].family}:{folder(kind)}"
    there = make_image_encoder(name, options=ModelOptions("cuda", 2, autocast))
    frames = [picture(30, 220), picture(220, 30), picture(90, 160)]  # one more than a batch
    assert there.name == here.name
    for first, second in (
        (here.encode_texts(["red chair", "sofa", "lamp"]), there.encode_texts(["red chair", "sofa", "lamp"])),
        (here.encode_images(frames), there.encode_images(frames)),
        (here.encode_patches(frames), there.encode_patches(frames)),
    ):
        assert second.dtype == np.float32
        assert second.shape == first.shape
        assert (first * second).sum(axis=-1).min() > (1 - 1e-4 if autocast == "off" else 0.99)


@pytest.mark.gpu
@ALL
def test_on_a_gpu_our_adapters_keep_the_contract(kind: str, folder) -> None:
    options = ModelOptions(device="cuda")
    assert check_image_encoder(make_image_encoder(f"{KINDS[kind].family}:{folder(kind)}", options=options)) == []


@pytest.mark.gpu
def test_a_full_gpu_is_refused_and_usable_again_with_more_memory(folder) -> None:
    eye = make_image_encoder(f"clip:{folder('clip')}", options=ModelOptions(device="cuda", batch_size=2_000))
    frames = [picture(30, 220)] * 2_000  # 23 MiB of pixels
    torch.cuda.empty_cache()
    torch.cuda.set_per_process_memory_fraction(0.0)
    try:
        with pytest.raises(AgentError, match="'cuda': has too little free memory"):
            eye.encode_images(frames)
    finally:
        torch.cuda.set_per_process_memory_fraction(1.0)
    assert eye.encode_images(frames[:1]).shape == (1, eye.dim)
