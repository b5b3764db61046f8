"""The library of open homes: opened once, kept while used, closed oldest first, warmed in the background."""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from personal_viz.study_app.home.homes import HomeLibrary
from sim.errors import SceneError
from sim.tasks.pan import PanEnv
from sim.tasks.pog import PogScene

from ..human_study.small_world import study
from .stage import invented_home

TIMEOUT_S = 10.0


class FakeHome:
    """A home that knows whether it is open."""

    def __init__(self, scene: str) -> None:
        """Open."""
        self.scene = scene
        self.closed = threading.Event()

    def close(self) -> None:
        """A home is closed once."""
        assert not self.closed.is_set()
        self.closed.set()


class Opener:
    """Opens fake homes, counts them, and can be held up or made to fail."""

    def __init__(self) -> None:
        """Opens at once."""
        self.opened: list[FakeHome] = []
        self.may_open = threading.Event()
        self.may_open.set()
        self.begun = threading.Event()
        self.fails = False

    def __call__(self, scene: str) -> FakeHome:
        """As `open_home`."""
        self.begun.set()
        assert self.may_open.wait(TIMEOUT_S)
        if self.fails:
            raise SceneError(f"{scene}: is not there; expected a file. Look again.")
        self.opened.append(FakeHome(scene))
        return self.opened[-1]


def test_a_home_is_opened_once_for_all_who_ask_at_the_same_time() -> None:
    opener = Opener()
    opener.may_open.clear()
    library = HomeLibrary(opener)
    people_in = threading.Barrier(9)

    def visit(_: int) -> FakeHome:
        people_in.wait(TIMEOUT_S)
        with library.use("A") as home:
            return home

    with ThreadPoolExecutor(8) as pool:
        visits = [pool.submit(visit, number) for number in range(8)]
        people_in.wait(TIMEOUT_S)
        assert opener.begun.wait(TIMEOUT_S)
        opener.may_open.set()
        homes = {id(visit.result(TIMEOUT_S)) for visit in visits}
    assert len(homes) == 1
    assert len(opener.opened) == 1
    library.close()


def test_the_home_unused_for_longest_is_closed_first_and_one_in_use_never() -> None:
    opener = Opener()
    library = HomeLibrary(opener, kept=1)
    with library.use("A") as used:
        for scene in ("B", "C", "D"):
            with library.use(scene):
                pass
        assert not used.closed.is_set()
        assert [home.scene for home in opener.opened if home.closed.is_set()] == ["B", "C"]
    assert [home.scene for home in opener.opened if not home.closed.is_set()] == ["A"]
    with library.use("A") as again:
        assert again is used
    library.close()
    assert all(home.closed.is_set() for home in opener.opened)


def test_a_warmed_home_is_there_when_it_is_used() -> None:
    opener = Opener()
    library = HomeLibrary(opener)
    opener.may_open.clear()
    library.warm("A")
    assert opener.begun.wait(TIMEOUT_S)
    library.warm("A")
    with ThreadPoolExecutor(1) as pool:

        def scene_of_use() -> str:
            with library.use("A") as home:
                return home.scene

        use = pool.submit(scene_of_use)
        opener.may_open.set()
        assert use.result(TIMEOUT_S) == "A"
    assert len(opener.opened) == 1
    library.close()


def test_a_person_does_not_wait_behind_another_home_that_is_being_warmed() -> None:
    hold = threading.Event()
    begun = threading.Event()

    def open_home(scene: str) -> FakeHome:
        if scene == "slow":
            begun.set()
            assert hold.wait(TIMEOUT_S)
        return FakeHome(scene)

    library = HomeLibrary(open_home)
    library.warm("slow")
    assert begun.wait(TIMEOUT_S)
    library.warm("A")  # waits in line behind the slow one
    with library.use("A") as home:
        assert home.scene == "A"
    hold.set()
    library.close()


def test_a_home_that_cannot_be_opened_says_so_each_time_and_can_be_tried_again() -> None:
    opener = Opener()
    opener.fails = True
    library = HomeLibrary(opener)
    assert isinstance(library.warm("A").exception(TIMEOUT_S), SceneError)
    with pytest.raises(SceneError, match="A: is not there"), library.use("A"):
        pass
    opener.fails = False
    with library.use("A") as home:
        assert home.scene == "A"
    library.close()


def test_a_home_that_nobody_wants_any_more_is_not_opened_until_somebody_asks_again() -> None:
    opener = Opener()
    opener.may_open.clear()
    library = HomeLibrary(opener)
    first, unwanted = library.warm("A"), library.warm("B")
    assert opener.begun.wait(TIMEOUT_S)
    assert library.warm("A") is first
    assert not first.cancel()
    assert unwanted.cancel()
    opener.may_open.set()
    assert library.warm("C").result(TIMEOUT_S).scene == "C"
    assert [home.scene for home in opener.opened] == ["A", "C"]
    assert library.warm("B").result(TIMEOUT_S).scene == "B"
    library.close()


def test_a_closed_library_warms_nothing() -> None:
    opener = Opener()
    library = HomeLibrary(opener)
    library.close()
    assert library.warm("A").cancelled()
    assert opener.opened == []


def noted(used: list[tuple[str, Any]], name: str, method: Callable[..., Any]) -> Callable[..., Any]:
    """The method, whose answers are noted."""

    def call(*args: Any) -> Any:
        used.append((name, method(*args)))
        return used[-1][1]

    return call


@pytest.mark.slow
def test_a_home_is_tried_out_as_people_use_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home, used = invented_home(tmp_path, study()), []
    for owner, name in ((PanEnv, "reset"), (PanEnv, "step"), (PogScene, "hit")):
        monkeypatch.setattr(owner, name, noted(used, name, getattr(owner, name)))
    home.try_out(study())
    (_, first), (_, moved), (_, floor) = used
    assert [name for name, _ in used] == ["reset", "step", "hit"]
    assert first.rgb is not None
    assert moved.rgb is not None
    assert floor is not None
