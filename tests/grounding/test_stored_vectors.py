"""Vectors kept on disk: encoded once per machine, shared, and never trusted when damaged."""

import sqlite3
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from grounding.checks import check_encoder
from grounding.encoders.hashed import HashedWords
from grounding.encoders.stored_vectors import StoredTextEncoder

WORDS = HashedWords()


class Counting(HashedWords):
    asked: list[list[str]]

    def __init__(self) -> None:
        super().__init__()
        self.asked = []

    def encode_texts(self, texts):
        self.asked.append(list(texts))
        return super().encode_texts(texts)


def stored(folder: Path, encoder: HashedWords, *, key: str = "k") -> StoredTextEncoder:
    return StoredTextEncoder(lambda: encoder, name=WORDS.name, dim=WORDS.dim, key=key, folder=folder)


def test_a_text_is_encoded_once_for_all_processes(tmp_path: Path) -> None:
    first, second = Counting(), Counting()
    stored(tmp_path, first).encode_texts(["red chair", "oak table", "red chair"])
    texts = ["oak table", "grey sofa", "red chair"]
    assert np.array_equal(stored(tmp_path, second).encode_texts(texts), WORDS.encode_texts(texts))
    assert first.asked == [["red chair", "oak table"]]
    assert second.asked == [["grey sofa"]]


def test_the_encoder_is_not_even_made_when_all_is_known(tmp_path: Path) -> None:
    stored(tmp_path, Counting()).encode_texts(["red chair"])

    def never() -> HashedWords:
        raise AssertionError("the encoder was loaded")

    again = StoredTextEncoder(never, name=WORDS.name, dim=WORDS.dim, key="k", folder=tmp_path)
    assert np.array_equal(again.encode_texts(["red chair"]), WORDS.encode_texts(["red chair"]))
    assert again.encode_texts([]).shape == (0, 768)


def test_few_new_vectors_are_written_in_the_end_and_many_at_once(tmp_path: Path) -> None:
    first, second = stored(tmp_path, Counting()), Counting()
    vector = first.encode_texts(["red chair"])
    assert not (tmp_path / f"{WORDS.name}-k.sqlite").exists()
    assert np.array_equal(first.encode_texts(["red chair"]), vector)
    first.encode_texts([f"thing number{i}" for i in range(300)])
    stored(tmp_path, second).encode_texts(["red chair", "thing number0", "thing number299"])
    assert second.asked == []
    first.encode_texts(["oak table"])
    del first
    stored(tmp_path, second).encode_texts(["oak table"])
    assert second.asked == []


def test_what_a_process_has_left_to_write_is_written_when_it_ends(tmp_path: Path) -> None:
    program = f"""
from pathlib import Path
from grounding.encoders.hashed import HashedWords
from grounding.encoders.stored_vectors import StoredTextEncoder
kept = StoredTextEncoder(HashedWords, name="{WORDS.name}", dim={WORDS.dim}, key="k", folder=Path({str(tmp_path)!r}))
kept.encode_texts(["red chair"])
"""
    subprocess.run([sys.executable, "-c", program], check=True)
    counting = Counting()
    stored(tmp_path, counting).encode_texts(["red chair"])
    assert counting.asked == []


def test_other_weights_have_a_file_of_their_own(tmp_path: Path) -> None:
    other = Counting()
    stored(tmp_path, Counting()).encode_texts(["red chair"])
    stored(tmp_path, other, key="other").encode_texts(["red chair"])
    assert other.asked == [["red chair"]]


def test_many_texts_and_odd_ones_come_back(tmp_path: Path) -> None:
    texts = [f"thing number{i}" for i in range(1200)] + ["", 'it\'s "odd"; -- ümlaut 桌子']
    stored(tmp_path, Counting()).encode_texts(texts)
    counting = Counting()
    assert np.array_equal(stored(tmp_path, counting).encode_texts(texts), WORDS.encode_texts(texts))
    assert counting.asked == []


def test_a_damaged_file_costs_time_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / f"{WORDS.name}-k.sqlite"
    path.write_bytes(b"not a database at all" * 100)
    assert np.array_equal(stored(tmp_path, Counting()).encode_texts(["lamp"]), WORDS.encode_texts(["lamp"]))


def test_a_cut_vector_is_encoded_again(tmp_path: Path) -> None:
    stored(tmp_path, Counting()).encode_texts(["lamp"])
    store = sqlite3.connect(tmp_path / f"{WORDS.name}-k.sqlite")
    with store:
        store.execute("UPDATE vectors SET vector = x'00'")
    store.close()
    assert np.array_equal(stored(tmp_path, Counting()).encode_texts(["lamp"]), WORDS.encode_texts(["lamp"]))


def test_a_folder_that_cannot_be_made_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    found = stored(tmp_path / "file" / "below", Counting()).encode_texts(["lamp"])
    assert np.array_equal(found, WORDS.encode_texts(["lamp"]))


def test_many_writers_do_not_hinder_each_other(tmp_path: Path) -> None:
    def write(worker: int) -> bool:
        texts = [f"thing number{i}" for i in range(worker * 10, worker * 10 + 40)]
        return bool(np.array_equal(stored(tmp_path, Counting()).encode_texts(texts), WORDS.encode_texts(texts)))

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(write, range(8)))
    late = Counting()
    stored(tmp_path, late).encode_texts([f"thing number{i}" for i in range(110)])
    assert late.asked == []


def test_stored_vectors_keep_the_encoders_contract(tmp_path: Path) -> None:
    assert check_encoder(stored(tmp_path, HashedWords())) == []
