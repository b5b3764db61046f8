"""One browser that looks through the library: messages in, panels and 3-D out, on a thread of its own.

viser's callbacks only put messages on the queue; files, links and rendering are never on viser's event loop. Texts go
to the browser before the home is touched, so that walking through episodes does not wait for 3-D.
"""

import sys
import threading
import traceback
from collections.abc import Callable
from concurrent.futures import Future

import viser

from sim.errors import PersonalVizError
from sim.tasks.run_files import EpisodeRun
from sim.types import Camera

from .layers import FIRST_LAYERS, Layers, Outlined, look_at_object, look_at_storey
from .library import PAGE, Library, OpenHome, Wanted, digest_of, nearest_page, neighbour
from .messages import HomeOpened, Message, MessageQueue, Words
from .panel_html import graph_html, history_html, notice_html, part_html, picture_html, runs_html, story_html
from .panels import Panels


class Visitor:
    """State of one browser."""

    def __init__(self, client: viser.ClientHandle, library: Library) -> None:
        """Builds the panels, shows the first episode and starts to listen."""
        self._client, self._library = client, library
        self._queue = MessageQueue()
        self._panels = Panels(client, self._queue.put, scenes=library.scenes, has_runs=any(library.num_runs))
        self._layers = Layers(client, self._box_clicked)
        self._matching = library.matching(Wanted())
        self._page = 0
        self._layers_on = FIRST_LAYERS
        self._hidden: set[str] = set()
        self._asked: Future[OpenHome] | None = None
        """The home that is being opened for this browser."""
        self._home: OpenHome | None = None
        self._storey = 0
        self._marked: int | None = None
        self._walked: int | None = None
        self._step_of_walk = 0
        self._shown = library.read(0)
        threading.Thread(target=self._work, name=f"visitor {client.client_id}", daemon=True).start()

    def leave(self) -> None:
        """The browser is gone."""
        self._queue.end()

    async def _box_clicked(self, index: int) -> None:
        self._queue.put(("box", str(index)))

    def _work(self) -> None:
        self._guarded(lambda: self._show(0))
        for message in self._queue:
            self._guarded(lambda message=message: self._handle(message))

    def _guarded(self, work: Callable[[], None]) -> None:
        """The event loop's door: a bug in one message is shown and printed, and the next message is handled."""
        try:
            work()
            self._client.flush()
        except PersonalVizError as error:
            self._panels.show("home", notice_html(str(error), is_warning=True))
        except Exception:
            traceback.print_exc(file=sys.stderr)
            self._panels.show("home", notice_html("A bug: see the terminal.", is_warning=True))

    def _handle(self, message: Message) -> None:
        match message:
            case Wanted():
                self._matching, self._page = self._library.matching(message), 0
                self._draw_list()
                self._draw_head()
            case HomeOpened(scene, home):
                if scene == self._shown.episode.key.scene and self._home is None:
                    self._ask_home() if home.cancelled() else self._enter(home.result())
            case _:
                self._obey(message)

    def _obey(self, words: Words) -> None:
        """Obeys a widget, our HTML or a box in 3-D; numbers of an episode shown before are dropped."""
        num_links, num_runs = len(self._shown.links), len(self._shown.traces)
        match words:
            case ("hover", *node):
                self._hover(node[0] if node else "")
            case ("box", index) if int(index) < num_links:
                self._select(int(index))
            case ("object", index) if int(index) < num_links:
                self._select(int(index))
                self._go_to(int(index))
            case ("episode", number):
                self._show(int(number))
            case ("step", by):
                number = neighbour(self._matching, self._shown.number, int(by))
                if number is not None and number != self._shown.number:
                    self._show(number)
            case ("storey", storey):
                self._show_storey(int(storey), look=True)
            case ("layer", ("view_points" | "region" | "names") as layer):
                self._layers_on ^= {layer}
                self._draw_home()
            case ("page", by):
                self._page += int(by)
                self._draw_list()
            case ("show", index) if int(index) < num_runs:
                self._hidden ^= {self._shown.traces[int(index)].title}
                self._draw_runs()
                self._draw_home()
            case ("walk", index) if int(index) < num_runs:
                self._walked = int(index)
                self._draw_runs()
                self._start_walk()
            case ("slide", step):
                self._show_step(int(step), follow=True)

    def _show(self, number: int) -> None:
        """Texts first, then the home: at once where it is open, else when it is."""
        self._shown, self._marked, self._step_of_walk = self._library.read(number), None, 0
        episode, traces = self._shown.episode, self._shown.traces
        self._walked = next((i for i, trace in enumerate(traces) if isinstance(trace.run, EpisodeRun)), None)
        if number in self._matching:
            self._page = self._matching.index(number) // PAGE
        if self._home is not None and self._home.scene.name != episode.key.scene:
            self._home = None
        self._draw_head()
        self._panels.show("story", story_html(episode, self._shown.graph) + history_html(self._shown))
        self._panels.show("facts", part_html("facts", episode=episode))
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
        home = self._library.homes.warm(scene)
        if self._asked is not None and self._asked is not home:
            self._asked.cancel()  # another visitor who waits for it asks again
        self._asked = home
        if home.done() and not home.cancelled():
            self._enter(home.result())
            return
        self._panels.show("home", notice_html(f"Opening the home {scene} …"))
        home.add_done_callback(lambda done: self._queue.put(HomeOpened(scene, done)))

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
            look_at_storey(self._client, self._home, storey)
        self._draw_home()

    def _draw_home(self) -> None:
        if self._home is None:
            return
        scene, count = self._home.scene, len(self._home.copies.storeys)
        home = part_html(
            "home",
            label=scene.label,
            storeys=count,
            storey=self._storey,
            missing=scene.missing_storeys,
            layers=self._layers_on,
        )
        self._panels.show("home", home)
        self._layers.show_home(self._home, self._storey, names="names" in self._layers_on)
        self._layers.show_episode(self._shown, hidden=self._hidden, layers=self._layers_on)
        self._outline_marked()
        self._draw_walker()

    def _draw_walker(self) -> None:
        """The robot of the run that is walked along, where it is on the storey that is shown."""
        run = self._walked_run()
        if run is None or self._walked is None or self._home is None:
            self._layers.show_walker(None)
            return
        pose = run.poses[min(self._step_of_walk, len(run.steps))]
        is_here = self._home.storey(pose.position[1]) == self._storey
        self._layers.show_walker(pose if is_here else None, self._shown.traces[self._walked].rgb)

    def _draw_list(self) -> None:
        self._page = nearest_page(self._matching, self._page)
        pages = {"matching": self._matching, "first": PAGE * self._page, "size": PAGE}
        self._panels.show("list", part_html("list", library=self._library, **pages, here=self._shown.number))

    def _draw_head(self) -> None:
        number, total = self._shown.number, len(self._matching)
        place = self._matching.index(number) if number in self._matching else None
        self._panels.show("head", part_html("head", episode=self._shown.episode, place=place, total=total))

    def _draw_graph(self) -> None:
        self._panels.show("graph", graph_html(self._shown, marked=self._marked, notes=self._storey_notes()))

    def _draw_runs(self) -> None:
        notes = self._run_notes()
        self._panels.show("runs", runs_html(self._shown, hidden=self._hidden, walked=self._walked, notes=notes))

    def _storey_notes(self) -> list[str]:
        """The storey of each linked object, in homes with several."""
        if self._home is None or len(self._home.copies.storeys) < 2:
            return []
        goals = [self._shown.goals.get(link.goal or "") for link in self._shown.links]
        return ["" if goal is None else f"storey {self._home.storey(goal.floor_y) + 1}" for goal in goals]

    def _run_notes(self) -> list[str]:
        """Runs that were not made in the home that is shown."""
        digest = None if self._home is None else self._home.scene.digest
        others = [trace.title for trace in self._shown.traces if digest and digest_of(trace) not in (None, digest)]
        return (
            [f"Made in another home than the one shown, paths may cross walls: {', '.join(others)}"] if others else []
        )

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
        for link in (self._shown.links[index] for index in indexes):
            goal = self._shown.goals.get(link.goal or "")
            if goal is not None:
                storey = self._home.storey(goal.floor_y)
                where = "" if storey == self._storey else f" (storey {storey + 1})"
                owners = [edge.owner for edge in self._shown.graph.edges if edge.node == link.node]
                outlined.append(Outlined(*self._home.box(goal), f"{', '.join(owners)}{where}"))
        self._layers.mark(outlined)

    def _select(self, index: int) -> None:
        """Marks an object node in graph and home."""
        self._marked = index
        self._draw_graph()
        self._outline_marked()

    def _go_to(self, index: int) -> None:
        """Shows an object's storey and moves the camera to it."""
        goal = self._shown.goals.get(self._shown.links[index].goal or "")
        if goal is None or self._home is None:
            return
        storey = self._home.storey(goal.floor_y)
        if storey != self._storey:
            self._show_storey(storey, look=False)
        look_at_object(self._client, *self._home.box(goal))

    def _walked_run(self) -> EpisodeRun | None:
        """The run along which the slider leads."""
        run = None if self._walked is None else self._shown.traces[self._walked].run
        return run if isinstance(run, EpisodeRun) else None

    def _start_walk(self) -> None:
        run = self._walked_run()
        self._layers.show_walker(None)  # the next one has its own colour
        if run is None or self._home is None:
            self._panels.show_walk(None)
            return
        self._panels.show_walk(len(run.steps))
        self._show_step(0, follow=False)

    def _show_step(self, step: int, *, follow: bool) -> None:
        """Shows the robot at a step of the run, and its picture; `follow` shows the storey of the robot."""
        run = self._walked_run()
        if run is None or self._walked is None or self._home is None:
            return
        poses = run.poses
        step = min(max(step, 0), len(poses) - 1)
        storey = self._home.storey(poses[step].position[1])
        if follow and storey != self._storey:
            self._show_storey(storey, look=True)
        self._step_of_walk = step
        self._draw_walker()
        self._client.flush()
        action = "start" if step == 0 else run.steps[step - 1].action.value
        bumped = ", bumped" if step and run.steps[step - 1].collided else ""
        where = f", storey {storey + 1}" if len(self._home.copies.storeys) > 1 else ""
        title = self._shown.traces[self._walked].title
        caption = f"{title}: step {step} of {len(poses) - 1} ({action}{bumped}{where})"
        picture = picture_html(self._home.picture(poses[step], Camera()), step=step, caption=caption)
        self._panels.show("picture", picture)
