"""Tiny vision-language models with random weights, saved like the real ones, and pictures for them."""

from pathlib import Path

import numpy as np
import torch
import transformers
from tokenizers import Tokenizer, models, normalizers, pre_tokenizers, processors

from sim.types import Camera, Frame

WORDS = (
    *("a", "red", "wooden", "chair", "beside", "the", "window", "large", "white", "sofa", "oval", "mirror", "with"),
    *("golden", "frame", "find", "mira", "tom", "s", "owns", "in", "kitchen", "lounge", "table", "lamp"),
)
SPECIALS = ("<pad>", "<unk>", "<bos>", "<eos>")
SIZE, PATCH = 32, 8
"""Sides of the models' square pictures and of their patches, in pixels: 4 x 4 patches."""
VISION = {
    "hidden_size": 32,
    "intermediate_size": 48,
    "num_hidden_layers": 2,
    "num_attention_heads": 4,
    "patch_size": PATCH,
}
ENDS = {"pad_token_id": 0, "bos_token_id": 2, "eos_token_id": 3}
TEXT = {"hidden_size": 32, "intermediate_size": 48, "num_hidden_layers": 2, "num_attention_heads": 4}


def save_clip(folder: Path, *, seed: int = 0) -> Path:
    text = {**TEXT, "vocab_size": 40, "max_position_embeddings": 16, **ENDS}
    config = transformers.CLIPConfig(text_config=text, vision_config={**VISION, "image_size": SIZE}, projection_dim=24)
    processor = transformers.CLIPImageProcessorPil(size={"shortest_edge": SIZE}, crop_size=SIZE)
    return _save(folder, transformers.CLIPModel, config, processor, seed=seed)


def save_siglip(folder: Path, *, seed: int = 0) -> Path:
    text = {**TEXT, "vocab_size": 40, "max_position_embeddings": 12, "projection_size": 32, **ENDS}
    config = transformers.SiglipConfig(text_config=text, vision_config={**VISION, "image_size": SIZE})
    processor = transformers.SiglipImageProcessorPil(size={"height": SIZE, "width": SIZE})
    return _save(folder, transformers.SiglipModel, config, processor, seed=seed)


def save_siglip_naflex(folder: Path, *, seed: int = 0) -> Path:
    text = {**TEXT, "vocab_size": 40, "max_position_embeddings": 12, "projection_size": 32, **ENDS}
    config = transformers.Siglip2Config(text_config=text, vision_config={**VISION, "num_patches": 16})
    processor = transformers.Siglip2ImageProcessorPil(patch_size=PATCH, max_num_patches=16)
    letters = {mark: index for index, mark in enumerate((*SPECIALS, "<mask>", "▁", *"abcdefghijklmnopqrstuvwxyz"))}
    _save(folder, transformers.Siglip2Model, config, processor, seed=seed)
    transformers.Siglip2Tokenizer(vocab=letters, merges=[]).save_pretrained(folder)
    return folder


def save_blip2(folder: Path, *, seed: int = 0) -> Path:
    qformer = {
        **TEXT,
        "vocab_size": 40,
        "max_position_embeddings": 20,
        "encoder_hidden_size": 32,
        "use_qformer_text_input": True,
    }
    opt = {"vocab_size": 40, "hidden_size": 8, "ffn_dim": 8, "num_hidden_layers": 1, "num_attention_heads": 1}
    config = transformers.Blip2Config(
        vision_config={**VISION, "image_size": 64, "qkv_bias": True},
        qformer_config=qformer,
        text_config={"model_type": "opt", **opt, "word_embed_proj_dim": 8, "max_position_embeddings": 8},
        num_query_tokens=6,
        image_text_hidden_size=16,
    )
    processor = transformers.BlipImageProcessorPil(size={"height": 64, "width": 64})
    return _save(folder, transformers.Blip2ForImageTextRetrieval, config, processor, seed=seed)


def save_owlv2(folder: Path, *, seed: int = 0) -> Path:
    text = {**TEXT, "vocab_size": 40, "max_position_embeddings": 16, **ENDS}
    vision = {**VISION, "image_size": 64, "patch_size": 16}
    config = transformers.Owlv2Config(text_config=text, vision_config=vision, projection_dim=32)
    processor = transformers.Owlv2ImageProcessorPil(size={"height": 64, "width": 64})
    return _save(folder, transformers.Owlv2ForObjectDetection, config, processor, seed=seed)


def save_grounding_dino(folder: Path, *, seed: int = 0) -> Path:
    bert = {**TEXT, "model_type": "bert", "vocab_size": 1100, "max_position_embeddings": 64}
    swin = {
        "model_type": "swin",
        "image_size": 64,
        "embed_dim": 16,
        "depths": [1, 1, 1, 1],
        "num_heads": [2, 2, 2, 2],
        "window_size": 4,
        "out_indices": [2, 3, 4],
    }
    config = transformers.GroundingDinoConfig(
        backbone_config=swin,
        text_config=bert,
        num_queries=12,
        encoder_layers=1,
        decoder_layers=2,
        encoder_ffn_dim=32,
        decoder_ffn_dim=32,
        encoder_attention_heads=4,
        decoder_attention_heads=4,
        d_model=32,
        max_text_len=32,
        disable_custom_kernels=True,
    )
    processor = transformers.GroundingDinoImageProcessorPil(size={"shortest_edge": 64, "longest_edge": 96})
    _save(folder, transformers.GroundingDinoForObjectDetection, config, processor, seed=seed)
    # the model knows the ids of BERT's own marks: it parts the text at the start, the end and the full stop
    places = {"[PAD]": 0, "[UNK]": 100, "[CLS]": 101, "[SEP]": 102, "[MASK]": 103, ".": 1012, "?": 1029}
    used = {number: word for word, number in places.items()} | dict(enumerate(WORDS, start=200))
    words = [used.get(number, f"[unused{number}]") for number in range(1100)]
    (folder / "vocab.txt").write_text("\n".join(words) + "\n")
    for name in ("tokenizer.json", "tokenizer_config.json", "special_tokens_map.json"):
        (folder / name).unlink(missing_ok=True)
    transformers.BertTokenizer(str(folder / "vocab.txt")).save_pretrained(folder)
    return folder


def picture(left: int, right: int, *, width: int = 96, height: int = 64, seed: int = 0) -> Frame:
    """A picture whose left and right halves are noise around two grey levels."""
    rng = np.random.default_rng(seed)
    level = np.where(np.arange(width) < width // 2, left, right)
    rgb = np.clip(level[None, :, None] + rng.integers(-20, 20, (height, width, 3)), 0, 255).astype(np.uint8)
    camera = Camera.of_lens(width, height, fx=80.0, fy=80.0, cx=width / 2, cy=height / 2)
    return Frame(rgb, np.ones((height, width), np.float32), np.eye(4), camera)


def _save(folder: Path, model_class, config, processor, *, seed: int) -> Path:
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        model = model_class(config)
        for values in model.parameters():
            if values.dim() > 1:  # some start at zero, or so small that all answers would be the same
                torch.nn.init.normal_(values, std=0.4)
    model.save_pretrained(folder)
    _tokenizer().save_pretrained(folder)
    processor.save_pretrained(folder)
    return folder


def _tokenizer() -> transformers.PreTrainedTokenizerFast:
    vocabulary = {word: index for index, word in enumerate((*SPECIALS, *WORDS))}
    made = Tokenizer(models.WordLevel(vocabulary, unk_token="<unk>"))
    made.normalizer = normalizers.Lowercase()
    made.pre_tokenizer = pre_tokenizers.Whitespace()
    made.post_processor = processors.TemplateProcessing(
        single="<bos> $A <eos>", special_tokens=[("<bos>", 2), ("<eos>", 3)]
    )
    return transformers.PreTrainedTokenizerFast(
        tokenizer_object=made, pad_token="<pad>", unk_token="<unk>", bos_token="<bos>", eos_token="<eos>"
    )
