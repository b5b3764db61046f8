"""A text encoder of your own: checked, used from Python, and named on the command line.

    personal-viz ground --dataset DATASET --method qs --encoder personal_viz.examples.example_3_your_own_encoder:make

This one makes vectors from character trigrams, so that "backpacks" is near "backpack". A real one would call a model;
with `encode_images` beside `encode_texts` it could also encode pictures (grounding.encoders.protocol.TextImageEncoder).
"""

import hashlib
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grounding import check_encoder
from grounding.evaluation.evaluate import GroundSettings, SceneGrounder
from sim import Dataset


class LetterTriples:
    """Encodes a text as the sum of fixed random vectors, one for each of its character trigrams."""

    name = "letter-triples-256"
    """Names the vector space; runs and maps carry it."""
    dim = 256

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, E) unit rows; zero for a text without letters."""
        rows = np.zeros((len(texts), self.dim), np.float32)
        for row, text in zip(rows, texts, strict=True):
            padded = f"  {text.lower().strip()} " if text.strip() else ""
            for at in range(len(padded) - 2):
                row += _vector(padded[at : at + 3])
        norms = np.linalg.norm(rows, axis=1, keepdims=True)
        return np.asarray(rows / np.where(norms > 0, norms, 1), np.float32)


def _vector(triple: str) -> NDArray[np.float32]:
    """The vector of a trigram; the same in every process, because it uses hashlib, not Python's hash()."""
    seed = int.from_bytes(hashlib.sha256(triple.encode()).digest()[:8], "big")
    return np.random.default_rng(seed).normal(size=LetterTriples.dim).astype(np.float32)


make = LetterTriples


def nearest(dataset: Path, encoder_name: str) -> float:
    """Metres from the target to the answer of query scoring, for the first episode on its oracle map."""
    episodes = Dataset(dataset)
    episode = next(episodes.episodes())
    grounder = SceneGrounder(episodes, episode.key.scene, GroundSettings("qs", encoder=encoder_name))
    found = grounder.ground(episode)
    x, _, z = found.candidates[0].position
    return min(float(np.hypot(x - goal.position[0], z - goal.position[2])) for goal in episode.targets)


if __name__ == "__main__":
    name = "personal_viz.examples.example_3_your_own_encoder:make"
    print("\n".join(check_encoder(name)) or f"{name} keeps the contract")
    for each in (name, "hashed"):
        print(f"{each}: {nearest(Path(sys.argv[1]), each):.1f} m from the target")
