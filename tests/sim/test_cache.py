"""The cache of files that are made once: kept by kind and key, never half-written, and never required."""

import os
from pathlib import Path

import pytest

from sim.cache import VARIABLE, cache_dir, cached_bytes


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


def never() -> bytes:
    raise AssertionError("made again")


def files_in(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if not path.is_dir()]


def test_content_is_made_once_per_kind_and_key_and_again_after_a_failure(folder: Path) -> None:
    assert cached_bytes("glb", "a", lambda: b"first") == b"first"
    assert cached_bytes("glb", "a", never) == b"first"
    assert cached_bytes("glb", "b", lambda: b"second") == b"second"
    assert cached_bytes("texels", "a", lambda: b"third") == b"third"
    assert cached_bytes("glb", "a", never) == b"first"
    assert sorted(path.suffix for path in files_in(folder)) == [".glb", ".glb", ".texels"]
    assert (folder / "glb").stat().st_mode & 0o077 == 0  # licensed geometry: no other user may read it
    with pytest.raises(ZeroDivisionError):
        cached_bytes("glb", "c", lambda: bytes(1 // 0))
    assert cached_bytes("glb", "c", lambda: b"content") == b"content"


def test_a_folder_that_cannot_be_written_costs_only_time(folder: Path) -> None:
    folder.write_text("a file is in the way")
    assert cached_bytes("glb", "a", lambda: b"content") == b"content"
    assert cached_bytes("glb", "a", lambda: b"content") == b"content"


def test_a_file_that_cannot_be_finished_leaves_nothing_behind(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    assert cached_bytes("glb", "a", lambda: b"content") == b"content"
    assert files_in(folder) == []


def test_the_default_is_the_users_cache_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_dir() == tmp_path / "personal-viz"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_dir() == Path.home() / ".cache" / "personal-viz"
