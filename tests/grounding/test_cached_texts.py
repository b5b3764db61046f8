"""Texts are encoded once and kept in memory and on disk; processes share the file, and a damaged one is not used."""

import sqlite3
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from grounding.encoders.cached_texts import CachedTextEncoder
from grounding.encoders.hashed import HashedWords

WORDS = HashedWords()


class Counting(HashedWords):
    """Remembers the texts that it encoded."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[list[str]] = []

    def encode_texts(self, texts):
        self.asked.append(list(texts))
        return super().encode_texts(texts)


def kept(folder: Path, encoder: HashedWords) -> CachedTextEncoder:
    return CachedTextEncoder(encoder, file=folder / "vectors.sqlite")


def test_each_text_is_encoded_once_and_a_full_cache_still_gives_right_vectors() -> None:
    inner = Counting()
    cached = CachedTextEncoder(inner)
    for texts in (["red chair", "oak table", "red chair"], ["oak table", "grey sofa"]):
        assert np.array_equal(cached.encode_texts(texts), WORDS.encode_texts(texts))
    assert inner.asked == [["red chair", "oak table"], ["grey sofa"]]
    assert cached.encode_texts([]).shape == (0, 768)
    cached = CachedTextEncoder(HashedWords(), max_texts=2)
    cached.encode_texts(["red chair", "oak table"])
    texts = ["oak table", "grey sofa", "red chair"]
    assert np.array_equal(cached.encode_texts(texts), WORDS.encode_texts(texts))


def test_many_texts_and_unusual_ones_are_read_back_and_encoded_once_for_all_processes(tmp_path: Path) -> None:
    first, second = Counting(), Counting()
    kept(tmp_path, first).encode_texts(["red chair", "oak table", "red chair"])
    texts = ["oak table", "grey sofa", "red chair"]
    assert np.array_equal(kept(tmp_path, second).encode_texts(texts), WORDS.encode_texts(texts))
    assert first.asked == [["red chair", "oak table"]]
    assert second.asked == [["grey sofa"]]
    texts = [f"thing number{i}" for i in range(1200)] + ["", 'it\'s "odd"; -- ümlaut 桌子']
    kept(tmp_path, Counting()).encode_texts(texts)
    counting = Counting()
    assert np.array_equal(kept(tmp_path, counting).encode_texts(texts), WORDS.encode_texts(texts))
    assert counting.asked == []


def test_a_few_new_vectors_are_written_at_the_end_and_many_are_written_immediately(tmp_path: Path) -> None:
    first, second = kept(tmp_path, Counting()), Counting()
    first.encode_texts(["red chair"])
    assert not (tmp_path / "vectors.sqlite").exists()
    first.encode_texts([f"thing number{i}" for i in range(300)])
    kept(tmp_path, second).encode_texts(["red chair", "thing number0", "thing number299"])
    first.encode_texts(["oak table"])
    del first
    kept(tmp_path, second).encode_texts(["oak table"])
    assert second.asked == []


@pytest.mark.slow
def test_vectors_that_are_not_written_yet_are_written_when_the_process_ends(tmp_path: Path) -> None:
    program = f"""
from pathlib import Path
from grounding.encoders.cached_texts import CachedTextEncoder
from grounding.encoders.hashed import HashedWords
kept = CachedTextEncoder(HashedWords(), file=Path({str(tmp_path / "vectors.sqlite")!r}))
kept.encode_texts(["red chair"])
"""
    subprocess.run([sys.executable, "-c", program], check=True)
    counting = Counting()
    kept(tmp_path, counting).encode_texts(["red chair"])
    assert counting.asked == []


def not_a_database(folder: Path) -> Path:
    (folder / "vectors.sqlite").write_bytes(b"not a database at all" * 100)
    return folder


def cut_vectors(folder: Path) -> Path:
    kept(folder, Counting()).encode_texts(["lamp"])
    store = sqlite3.connect(folder / "vectors.sqlite")
    with store:
        store.execute("UPDATE vectors SET vector = x'00'")
    store.close()
    return folder


def no_folder(folder: Path) -> Path:
    (folder / "file").write_text("in the way")
    return folder / "file" / "below"


@pytest.mark.parametrize("damage", [not_a_database, cut_vectors, no_folder])
def test_a_damaged_file_costs_only_time(damage, tmp_path: Path) -> None:
    found = kept(damage(tmp_path), Counting()).encode_texts(["lamp"])
    assert np.array_equal(found, WORDS.encode_texts(["lamp"]))


def test_many_processes_can_write_at_once(tmp_path: Path) -> None:
    def write(worker: int) -> bool:
        texts = [f"thing number{i}" for i in range(worker * 10, worker * 10 + 40)]
        return bool(np.array_equal(kept(tmp_path, Counting()).encode_texts(texts), WORDS.encode_texts(texts)))

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(write, range(8)))
    late = Counting()
    kept(tmp_path, late).encode_texts([f"thing number{i}" for i in range(110)])
    assert late.asked == []
