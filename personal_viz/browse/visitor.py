"""One browser that looks through the library: messages in, panels and 3-D out. A thread of its own.

viser's callbacks only put messages on the queue; files, links and rendering are never on viser's event loop. Texts go
to the browser before the home is touched, so that walking through episodes does not wait for 3-D.
"""

import sys
import threading
import traceback
from dataclasses import dataclass, replace

import viser

from sim.episodes.ownership import OwnershipGraph, ownership_graph
from sim.episodes.schema import Episode, Goal
from sim.errors import DatasetError, PersonalVizError
from sim.types import Camera

from . import cameras, episode_texts, graph_svg
from .catalogue import PAGE, Wanted, list_page, neighbour
from .layers import Layers, Outlined, box_of
from .library import Library, OpenHome
from .messages import BoxClicked, Filtered, HomeOpened, Message, MessageQueue, Said, Slid, Stepped
from .object_links import ObjectLink, object_links
from .panels import Panels
from .shown import LayerChoice, Shown


@dataclass(frozen=True, slots=True)
class ShownEpisode:
    """What is on the screen."""

    number: int
    episode: Episode
    graph: OwnershipGraph
    links: tuple[ObjectLink, ...]
    runs: tuple[Shown, ...]


class Visitor:
    """State of one browser."""

    def __init__(self, client: viser.ClientHandle, library: Library) -> None:
        """Builds the panels, shows the first episode and starts to listen."""
        self._client, self._library = client, library
        self._queue = MessageQueue()
        catalogue = library.catalogue
        self._panels = Panels(client, self._queue.put, scenes=catalogue.scenes, has_runs=any(catalogue.num_runs))
        self._layers = Layers(client, self._box_clicked)
        self._matching = catalogue.matching(Wanted())
        self._page = 0
        self._choice = LayerChoice()
        self._hidden: set[str] = set()
        self._home: OpenHome | None = None
        self._storey = 0
        self._marked: int | None = None
        self._walked: int | None = None
        self._step_of_walk = 0
        self._shown = self._read(0)
        threading.Thread(target=self._work, name=f"visitor {client.client_id}", daemon=True).start()

    def leave(self) -> None:
        """The browser is gone."""
        self._queue.end()

    async def _box_clicked(self, index: int) -> None:
        self._queue.put(BoxClicked(index))

    def _work(self) -> None:
        self._guarded(lambda: self._show(0))
        for message in self._queue:
            self._guarded(lambda message=message: self._handle(message))

    def _guarded(self, work) -> None:
        """The event loop's door: a bug in one message is shown and printed, and the next message is handled."""
        try:
            work()
            self._client.flush()
        except PersonalVizError as error:
            self._panels.show("home", episode_texts.notice_html(str(error), is_warning=True))
        except Exception:
            traceback.print_exc(file=sys.stderr)
            self._panels.show("home", episode_texts.notice_html("A bug: see the terminal.", is_warning=True))

    def _handle(self, message: Message) -> None:
        match message:
            case Filtered(wanted):
                self._matching, self._page = self._library.catalogue.matching(wanted), 0
                self._draw_list()
                self._draw_head()
            case Stepped(by):
                self._step(by)
            case Slid(step):
                self._show_step(step, follow=True)
            case BoxClicked(index):
                self._select(index)
            case HomeOpened(scene, home):
                if scene == self._shown.episode.key.scene and self._home is None:
                    self._ask_home() if home.cancelled() else self._enter(home.result())
            case Said(words):
                self._said(words.split())

    def _said(self, words: list[str]) -> None:
        """Numbers may be of an episode that was on the screen before: such messages are dropped."""
        links, runs = len(self._shown.links), len(self._shown.runs)
        match words:
            case ["hover", *node]:
                self._hover(node[0] if node else "")
            case ["click", "object", index] if int(index) < links:
                self._select(int(index))
                self._go_to(int(index))
            case ["click", "episode", number]:
                self._show(int(number))
            case ["click", "step", by]:
                self._step(int(by))
            case ["click", "storey", storey]:
                self._show_storey(int(storey), look=True)
            case ["click", "layer", ("view_points" | "region" | "names") as layer]:
                self._choice = replace(self._choice, **{layer: not getattr(self._choice, layer)})
                self._draw_home()
            case ["click", "page", by]:
                self._page += int(by)
                self._draw_list()
            case ["click", "show", index] if int(index) < runs:
                self._hidden ^= {self._shown.runs[int(index)].label}
                self._draw_runs()
                self._draw_home()
            case ["click", "walk", index] if int(index) < runs:
                self._walked = int(index)
                self._draw_runs()
                self._start_walk()

    def _step(self, by: int) -> None:
        number = neighbour(self._matching, self._shown.number, by)
        if number is not None and number != self._shown.number:
            self._show(number)

    def _read(self, number: int) -> ShownEpisode:
        episode = self._library.catalogue.episodes[number]
        try:
            graph = ownership_graph(episode)
        except DatasetError:  # personal-viz validate lists such sentences; the rest of the episode can be looked at
            graph = OwnershipGraph(())
        links = object_links(episode, graph, self._library.texts[episode.key.scene])
        return ShownEpisode(number, episode, graph, links, self._library.runs.of(episode.key))

    def _show(self, number: int) -> None:
        """Texts first, then the home: at once where it is open, else when it is."""
        self._shown, self._marked, self._step_of_walk = self._read(number), None, 0
        self._walked = next((index for index, one in enumerate(self._shown.runs) if one.run is not None), None)
        if number in self._matching:
            self._page = self._matching.index(number) // PAGE
        if self._home is not None and self._home.scene.name != self._shown.episode.key.scene:
            self._home = None
        self._draw_head()
        self._panels.show("story", episode_texts.story_html(self._shown.episode, self._shown.graph))
        self._panels.show("facts", episode_texts.facts_html(self._shown.episode))
        self._draw_graph()
        self._draw_list()
        self._draw_runs()
        self._client.flush()
        if self._home is not None:
            self._enter(self._home)
        else:
            self._layers.clear()
            self._panels.show_walk(None)
            self._ask_home()

    def _ask_home(self) -> None:
        """Shows the episode's home if it is open; else says that it is being opened, and listens."""
        scene = self._shown.episode.key.scene
        future = self._library.homes.ask(scene)
        if future.done() and not future.cancelled():
            self._enter(future.result())
            return
        self._panels.show("home", episode_texts.notice_html(f"Opening the home {scene} …"))
        future.add_done_callback(lambda done: self._queue.put(HomeOpened(scene, done)))

    def _enter(self, home: OpenHome) -> None:
        """Shows the target's storey."""
        if self._home is not home:
            self._home = home
            self._draw_graph()
            self._draw_runs()
        self._show_storey(home.storey(self._shown.episode.targets[0].floor_y), look=True)
        self._start_walk()

    def _show_storey(self, storey: int, *, look: bool) -> None:
        if self._home is None:
            return
        self._storey = storey
        if look:
            cameras.look_at_storey(self._client, self._home, storey)
        self._draw_home()

    def _draw_home(self) -> None:
        if self._home is None:
            return
        shown, home = self._shown, self._home
        count = len(home.copies.storeys)
        self._panels.show(
            "home", episode_texts.home_html(home.scene.label, storeys=count, storey=self._storey, choice=self._choice)
        )
        self._layers.show_home(self._home, self._storey, names=self._choice.names)
        self._layers.show_episode(
            shown.episode,
            shown.links,
            shown.runs,
            goals=self._goals,
            hidden=self._hidden,
            choice=self._choice,
        )
        self._outline_marked()
        self._draw_walker()

    def _draw_walker(self) -> None:
        """The robot of the run that is walked along, where it is on the storey that is shown."""
        one = None if self._walked is None else self._shown.runs[self._walked]
        if one is None or one.run is None or self._home is None:
            self._layers.show_walker(None)
            return
        pose = one.run.poses[min(self._step_of_walk, len(one.run.steps))]
        is_here = self._home.storey(pose.position[1]) == self._storey
        self._layers.show_walker(pose if is_here else None, one.rgb)

    def _draw_list(self) -> None:
        page = list_page(self._matching, self._page)
        self._page = page.first // PAGE
        self._panels.show("list", episode_texts.list_html(self._library.catalogue, page, self._shown.number))

    def _draw_head(self) -> None:
        number = self._shown.number
        place = self._matching.index(number) if number in self._matching else None
        self._panels.show("head", episode_texts.head_html(self._shown.episode, place=place, total=len(self._matching)))

    def _draw_graph(self) -> None:
        shown = self._shown
        drawing = graph_svg.GraphDrawing(shown.graph, shown.links, shown.episode.record.owner, self._storey_notes())
        self._panels.show("graph", graph_svg.graph_html(drawing, marked=self._marked))

    def _draw_runs(self) -> None:
        shown = self._shown
        walked = None if self._walked is None else shown.runs[self._walked].label
        content = episode_texts.runs_html(shown.runs, hidden=self._hidden, walked=walked, notes=self._run_notes())
        self._panels.show("runs", content)

    def _storey_notes(self) -> tuple[str, ...]:
        if self._home is None or len(self._home.copies.storeys) < 2:
            return ("",) * len(self._shown.links)
        goals = [None if link.goal is None else self._goals.get(link.goal) for link in self._shown.links]
        return tuple("" if goal is None else f"storey {self._home.storey(goal.floor_y) + 1}" for goal in goals)

    def _run_notes(self) -> list[str]:
        """Runs that were not made in the home that is shown."""
        if self._home is None:
            return []
        scene = self._home.scene
        others = [one.label for one in self._shown.runs if one.scene_digest not in (None, scene.digest)]
        return (
            [f"Made in another home than the one shown, paths may cross walls: {', '.join(others)}"] if others else []
        )

    @property
    def _goals(self) -> dict[str, Goal]:
        return dict(self._library.texts[self._shown.episode.key.scene].goals)

    def _hover(self, node: str) -> None:
        """Outlines the object under the mouse, all objects of a person, or again the selected one."""
        graph = self._shown.graph
        kind, index = node[:1], int(node[1:] or 0)
        if kind == "o" and index < len(graph.objects):
            self._outline([index])
        elif kind == "p" and index < len(graph.people):
            theirs = {edge.node for edge in graph.edges if edge.owner == graph.people[index]}
            self._outline([place for place, name in enumerate(graph.objects) if name in theirs])
        else:
            self._outline_marked()

    def _outline_marked(self) -> None:
        self._outline([] if self._marked is None else [self._marked])

    def _outline(self, indexes: list[int]) -> None:
        if self._home is None:
            return
        outlined = []
        for index in indexes:
            link = self._shown.links[index]
            goal = self._goals.get(link.goal or "")
            if goal is not None:
                storey = self._home.storey(goal.floor_y)
                where = "" if storey == self._storey else f" (storey {storey + 1})"
                owners = [edge.owner for edge in self._shown.graph.edges if edge.node == link.node]
                outlined.append(Outlined(*box_of(goal, self._home), f"{', '.join(owners)}{where}"))
        self._layers.mark(outlined)

    def _select(self, index: int) -> None:
        """Marks an object node in graph and home."""
        if not 0 <= index < len(self._shown.links):
            return
        self._marked = index
        self._draw_graph()
        self._outline_marked()

    def _go_to(self, index: int) -> None:
        """Shows an object's storey and moves the camera to it."""
        goal = self._goals.get(self._shown.links[index].goal or "")
        if goal is None or self._home is None:
            return
        storey = self._home.storey(goal.floor_y)
        if storey != self._storey:
            self._show_storey(storey, look=False)
        cameras.look_at_object(self._client, *box_of(goal, self._home))

    def _start_walk(self) -> None:
        run = None if self._walked is None else self._shown.runs[self._walked].run
        if run is None or self._walked is None or self._home is None:
            self._panels.show_walk(None)
            self._layers.show_walker(None)
            return
        self._panels.show_walk(len(run.steps))
        self._layers.show_walker(None)  # the next one has its own colour
        self._show_step(0, follow=False)

    def _show_step(self, step: int, *, follow: bool) -> None:
        """The robot at a step of the run and what it saw; `follow` shows the storey on which that is."""
        if self._walked is None or self._home is None:
            return
        one = self._shown.runs[self._walked]
        if one.run is None:
            return
        poses = one.run.poses
        step = min(max(step, 0), len(poses) - 1)
        storey = self._home.storey(poses[step].position[1])
        if follow and storey != self._storey:
            self._show_storey(storey, look=True)
        self._step_of_walk = step
        self._draw_walker()
        self._client.flush()
        action = "start" if step == 0 else one.run.steps[step - 1].action.value
        bumped = ", bumped" if step and one.run.steps[step - 1].collided else ""
        where = f", storey {storey + 1}" if len(self._home.copies.storeys) > 1 else ""
        caption = f"{one.label}: step {step} of {len(poses) - 1} ({action}{bumped}{where})"
        self._panels.show(
            "picture", episode_texts.picture_html(self._home.picture(poses[step], Camera()), step=step, caption=caption)
        )
