"""Whole files and appended blocks are written completely, or the file stays as it was."""

import resource
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest

from sim.files import append_whole, write_whole


@contextmanager
def files_up_to(size: int) -> Iterator[None]:
    """Makes the system refuse to write files larger than this size (bytes), as a full disk would."""
    allowed = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, allowed[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, allowed)


def test_a_whole_file_replaces_the_old_one_or_leaves_it_as_it_was_if_writing_fails(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.json"
    write_whole(path, "one\n")
    write_whole(path, "zwölf\n")
    assert path.read_text(encoding="utf-8") == "zwölf\n"
    assert [item.name for item in path.parent.iterdir()] == ["a.json"]
    with files_up_to(1000), pytest.raises(OSError, match="too large"):
        write_whole(path, "x" * 2000)
    assert path.read_text(encoding="utf-8") == "zwölf\n"
    assert [item.name for item in path.parent.iterdir()] == ["a.json"]


def test_a_block_that_does_not_fit_is_removed_again(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    append_whole(path, "one\n")
    with files_up_to(1000), pytest.raises(OSError, match="too large"):
        append_whole(path, "x" * 2000)
    append_whole(path, "two\n")
    assert path.read_text() == "one\ntwo\n"


def test_several_writers_of_one_file_leave_a_whole_one(tmp_path: Path) -> None:
    path = tmp_path / "walk.json"
    texts = [letter * 50_000 for letter in "abcd"]
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda text: [write_whole(path, text) for _ in range(25)], texts))
    assert path.read_text() in texts
    assert list(tmp_path.iterdir()) == [path]
