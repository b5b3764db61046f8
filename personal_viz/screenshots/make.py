"""Makes the pictures of the README and of the instructions from the running program, on invented homes, nothing staged.

`make screenshots` makes the README's; `python -m personal_viz.screenshots.make NAME ...` makes some: a name of JOBS.
"""

import gzip
import json
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image
from playwright.sync_api import Page, expect

from grounding.maps.files import load_memory
from grounding.maps.home_map import ObjectMap
from grounding.methods.chat_grounders import numbered_things
from grounding.methods.map_picture import numbered_map
from human_study.design.plan import load_plan
from human_study.design.study import load_study
from sim.authoring.generation import dataset_files, invent_dataset, write_files
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.frames import T_world_camera, yaw_towards
from sim.homes.invented.plans import invent_plan
from sim.homes.open_home import open_scene, scene_from_plan
from sim.homes.plan import HomePlan
from sim.homes.recovered.plans import recover_plan
from sim.homes.renderers import raycaster_of
from sim.mesh import Scene
from sim.plan_view.axes import draw_free_floor
from sim.plan_view.storey import storey_map
from sim.tasks.rules import success_region
from sim.tasks.run_files import read_run
from sim.types import Action, Camera, EpisodeKey, Pose
from sim.walk.storeys import nearest_storey, same_storey

from ..annotate.app import Annotator, Workplace
from ..bench.homes.playability import home_facts
from ..browse.app import browser_app, loopback_app
from ..browse.library import open_library
from ..browser import open_chromium
from ..contact_sheet.sheet import contact_sheet_picture
from ..study_app.operator.served import ServedStudy, served
from ..study_app.page_script import STATIC
from ..view.shown import open_shown
from ..view.visit import Visit
from .rerun_page import picture_at_rest, screenshot_rrd
from .sequences import picture_sequences, picture_told
from .steps import PICTURES, WAIT_MS, point, press, run_agent, walk, work
from .study_pages import picture_instructions, picture_pages

RELEASE = Path(__file__).resolve().parents[3] / "shared" / "personal-dataset" / "split"
"""The released episodes, where they lie beside the checkout."""
_EXPLORER = "personal_viz.examples.example_2_your_own_agent:ExplainingAgent"
_KEYS = {Action.FORWARD: "w", Action.LEFT: "a", Action.RIGHT: "d"}
"""Keys of a participant; STOP is Enter twice."""
_METHODS = ("center", "qs", "rpg", "phrase", "joint")
_WORSE, _BETTER = "rpg", "joint"
"""Methods whose answers are replayed."""
_STATIC_JOBS = {"instructions", "sequences"}
"""Names of the jobs that change the pages of studies; they run only when they are asked for."""


def main() -> None:
    """Makes the pictures that were asked for."""
    names = sys.argv[1:] or [name for name in JOBS if name not in _STATIC_JOBS]
    PICTURES.mkdir(exist_ok=True)
    expect.set_options(timeout=WAIT_MS)
    for name in names:
        with tempfile.TemporaryDirectory(prefix=f"personal-{name}-") as folder:
            JOBS[name](Path(folder))
    print(f"Written to {PICTURES}" + (f" and {STATIC}" if _STATIC_JOBS & {*names} else ""))


def picture_demo(folder: Path) -> None:
    """PAN and POG of the demo, what its simulator shows, and its trial beside an agent in Rerun and in `compare`."""
    dataset = folder / "demo" / "dataset"
    with (
        served(["demo", "--seed", "5", "--out", str(folder / "demo"), "--port", "0"]) as study,
        open_chromium() as browser,
    ):
        plan = load_plan(folder / "demo/study", load_study(folder / "demo/study"))
        key = next(person.trials[0].key for person in plan.participants if person.trials[0].task == "pan")
        way = run_agent("shortest-path", dataset, folder / "way", "--episode", str(key))
        _walk_to_the_goal(browser.new_page(), study, way)
        _point_at_the_sofa(browser.new_page(), study)
    episodes = PersonalDataset(dataset)
    episode = next(episodes.episodes(splits=("hard",)))
    _draw_simulator(open_scene(episodes, episode.key.scene), episode)
    _compare(folder, dataset, key)


def picture_grounding(folder: Path) -> None:
    """An exploration and answers on an explored map in Rerun, and the POG report's page."""
    data = ["--dataset", str(folder / "homes")]
    invent_dataset(folder / "homes", name="Invented3", seed=3)
    exploration, pair, report = folder / "explore.rrd", folder / "pair.rrd", folder / "report"
    work("explore", *data, "--max-steps", "300", "--out", str(folder / "walks"), "--rerun", str(exploration))
    screenshot_rrd(exploration, PICTURES / "explore.png", at_end=True)
    runs = {method: folder / "runs" / method for method in _METHODS}
    for method in _METHODS:
        out = ["--out", str(folder / "runs"), "--run-id", method]
        work("ground", *data, *out, "--method", method, "--map", "explore")
    worse, better = (read_run(runs[method]).answers for method in (_WORSE, _BETTER))
    right = [
        good.key
        for bad, good in zip(worse, better, strict=True)
        if good.measures and bad.measures and good.measures.success and not bad.measures.success
    ]
    key = right[0] if right else better[0].key
    shown = ["--runs", str(runs[_WORSE]), str(runs[_BETTER])]
    work("replay", *data, "--episode", str(key), "--out", str(pair), *shown)
    screenshot_rrd(pair, PICTURES / "ground-explored.png", at_end=True)
    work("pog-report", *(str(path) for path in runs.values()), *data, "--out", str(report))
    with open_chromium(width=1500, height=1100) as browser:
        page = browser.new_page()
        page.goto((report / "index.html").as_uri())
        page.screenshot(path=PICTURES / "pog-report.png")


def picture_agents(folder: Path) -> None:
    """OneMap at the end of a search in Rerun: what it detected, its map of similarities, its frontiers and its goal."""
    homes, rrd = folder / "homes", folder / "onemap.rrd"
    invent_dataset(homes, name="Invented3", seed=3)
    key = next(PersonalDataset(homes).episodes(splits=("easy",))).key
    sees = ("--perception", "oracle:mild", "--episode", str(key))
    run_agent("onemap", homes, folder / "runs", *sees, "--rerun", str(rrd), "--with-pixels")
    screenshot_rrd(rrd, PICTURES / "onemap.png", at_end=True)


def picture_homes(folder: Path) -> None:
    """Contact sheets of an invented home, and of a schematic one where the released episodes are."""
    plans: dict[str, HomePlan] = {"home-invented.jpg": invent_plan("Invented7", seed=7)}
    if RELEASE.is_dir():
        plans["home-schematic.jpg"] = recover_plan(PersonalDataset(RELEASE), "TEEsavR23oF")
    else:
        print(f"{RELEASE}: not there; home-schematic.jpg stays as it is")
    for name, plan in plans.items():
        scene = scene_from_plan(plan)
        picture = contact_sheet_picture(scene, plan, facts=home_facts(scene, plan))
        picture = picture.resize((1400, round(picture.height * 1400 / picture.width)), Image.Resampling.LANCZOS)
        picture.save(PICTURES / name, quality=85)


def picture_scans(folder: Path) -> None:
    """The page of `check-scans` on an invented home, of whose records one length and one centre were falsified."""
    files = dataset_files("Invented7", seed=7, episodes_per_split=8)
    write_files(folder / "data", files)
    for path in (folder / "data").glob("*/content/*.json.gz"):
        content = json.loads(gzip.decompress(path.read_bytes()))
        content["episodes"][0]["info"]["geodesic_distance"] *= 1.5
        next(iter(content["goals_by_category"].values()))[0]["position"][0] += 0.9
        path.write_bytes(gzip.compress(json.dumps(content).encode()))
    scans = str(folder / "data" / "scenes")
    work("check-scans", "--dataset", str(folder / "data"), "--scenes-dir", scans, "--out", str(folder / "out"))
    with open_chromium(width=1350, height=900) as browser:
        page = browser.new_page()
        page.goto((folder / "out" / "check-scans.html").as_uri())
        page.screenshot(path=PICTURES / "check-scans.png")


def picture_tables(folder: Path) -> None:
    """The page of `reproduce` on an invented home."""
    write_files(folder / "data", dataset_files("Invented7", seed=7, episodes_per_split=8))
    few = ("--encoder", "hashed", "--method", "random", "center", "qs", "rpg", "dual", "--limit", "6")
    work("reproduce", "--dataset", str(folder / "data"), "--out", str(folder / "out"), *few)
    with open_chromium(width=1350, height=900) as browser:
        page = browser.new_page()
        page.goto((folder / "out" / "index.html").as_uri())
        page.screenshot(path=PICTURES / "reproduce.png")


def picture_ask(folder: Path) -> None:
    """Answers of `ask` in an invented home, to the query of an episode and to one that no phrase means."""
    data = folder / "data"
    invent_dataset(data, name="Invented3", seed=3)
    episode = next(PersonalDataset(data).episodes(scenes=("Invented3",), splits=("easy",)))
    asked = ("--description", episode.record.summary, "--query", episode.record.query[0], "--query", "the blue dresser")
    kept = ("--maps", str(folder / "maps"), "--out", str(folder / "answer"))
    work("ask", "Invented3", "--dataset", str(data), *asked, *kept)
    Image.open(folder / "answer.png").convert("RGB").save(PICTURES / "ask.jpg", quality=85)


def picture_chat(folder: Path) -> None:
    """The map of an invented home that `map-image-vlm` shows to a chat model."""
    data = folder / "data"
    write_files(data, dataset_files("Invented3", seed=3, episodes_per_split=1))
    explored = ("--map", "explore", "--layout", "objects", "--out", str(folder / "runs"))
    work("ground", "--dataset", str(data), "--method", "object-phrase", *explored)
    (file,) = (folder / "runs").glob("map-*/maps/*.npz")
    (storey,) = load_memory(file).storeys
    assert isinstance(storey.memory, ObjectMap)
    picture, _ = numbered_map(numbered_things(storey.memory), storey.occupancy)
    Image.fromarray(picture).save(PICTURES / "chat-map.png", optimize=True)


def picture_view(folder: Path) -> None:
    """`view` on an invented home, with two points and the robot a few steps away from its first place."""
    write_files(folder, dataset_files("Invented7", seed=7, episodes_per_split=1))
    shown = open_shown(folder / "scenes" / "Invented7.glb")
    with (
        loopback_app(lambda client: Visit(client, shown)) as address,
        open_chromium(width=1500, height=950) as browser,
    ):
        page = browser.new_page()
        page.goto(address)
        robot = page.locator(".robot")
        expect(robot).to_contain_text("step 0")
        picture_at_rest(page)  # clicks meet what is drawn
        for number, right in enumerate((0.28, 0.42), start=2):
            page.mouse.click(right * 1500, 0.5 * 950)
            expect(page.locator("table.points tr")).to_have_count(number)
        for number, key in enumerate("aaaw", start=1):
            page.keyboard.press(key)
            expect(robot).to_contain_text(f"step {number}")
        (PICTURES / "view.png").write_bytes(picture_at_rest(page))


def picture_annotate(folder: Path) -> None:
    """`annotate` on an invented home: some objects are described, one is being described."""
    write_files(folder, dataset_files("Invented7", seed=7, episodes_per_split=1))
    place = Workplace(open_shown(folder / "scenes" / "Invented7.glb"), folder, who="ada")
    session = place.session()
    for number, place_words in ((1, "below the window"), (2, "beside the cabinet"), (4, "near the stove")):
        session.select(number)
        session.keep(replace(session.form, captions=(f"{session.form.category} {place_words}",), room="kitchen"))
        session.save()
    with (
        loopback_app(lambda client: Annotator(client, place)) as address,
        open_chromium(width=1500, height=950) as browser,
    ):
        page = browser.new_page()
        page.goto(address)
        page.locator('[data-click="object 5"]').click()
        expect(page.locator(".grid img").first).to_be_visible()
        page.keyboard.press("e")
        page.keyboard.type("black coffee machine by the window")
        expect(page.locator(".row.here")).to_contain_text("window")
        page.keyboard.press("Escape")
        page.locator("[data-click='room kitchen']").click()
        (PICTURES / "annotate.png").write_bytes(picture_at_rest(page))


def picture_browse(folder: Path) -> None:
    """`browse`: an episode with two runs, one of its objects under the mouse."""
    dataset, runs = folder / "data", folder / "runs"
    write_files(dataset, dataset_files("Invented7", seed=7, episodes_per_split=8))
    found = tuple(
        run_agent(agent, dataset, runs, "--split", "medium", "--limit", "3", seed=3)
        for agent in ("shortest-path", "random")
    )
    with (
        browser_app(open_library(dataset, runs=found)) as address,
        open_chromium(width=1750, height=1200) as browser,
    ):
        page = browser.new_page()
        page.goto(address)
        expect(page.locator(".bw.home")).to_contain_text("invented home")
        page.locator(".rows .row", has_text="runs").first.click()
        picture = page.get_by_alt_text("What the robot saw")
        expect(picture).to_have_attribute("data-step", "0")
        page.get_by_role("slider").focus()
        for _ in range(12):
            page.keyboard.press("ArrowRight")
        expect(picture).to_have_attribute("data-step", "12")
        page.locator(".og .node.object.linked").first.hover()
        (PICTURES / "browse.png").write_bytes(picture_at_rest(page))  # homes are drawn after they have arrived


JOBS: dict[str, Callable[[Path], None]] = {
    "demo": picture_demo,
    "pages": picture_pages,
    "grounding": picture_grounding,
    "agents": picture_agents,
    "homes": picture_homes,
    "scans": picture_scans,
    "tables": picture_tables,
    "ask": picture_ask,
    "chat": picture_chat,
    "browse": picture_browse,
    "view": picture_view,
    "annotate": picture_annotate,
    "instructions": picture_instructions,
    "sequences": picture_sequences,
    "told": picture_told,
}
"""Functions that make pictures; each gets a folder for the files that it needs on the way."""


def _draw_simulator(scene: Scene, episode: Episode) -> None:
    """Draws what a robot near the end of an episode's shortest path sees, and the path on its storey's map."""
    way = scene.navigation.shortest_path(np.array(episode.start.position), success_region(episode, scene.navigation))
    assert way is not None, episode.key
    back = way[-2] - way[-1]
    x, y, z = (way[-1] + min(1.5 / max(float(np.linalg.norm(back)), 1e-9), 2 / 3) * back).tolist()
    target = episode.targets[0].position
    pose = Pose((x, y, z), yaw_towards((x, z), (target[0], target[2])))
    frame = raycaster_of(scene).render(T_world_camera(pose, Camera()), Camera())
    figure = Figure(figsize=(15, 3.3), dpi=100, layout="constrained")
    colour, depth, ids, above = figure.subplots(1, 4)
    colour.imshow(frame.rgb)
    shown = depth.imshow(np.where(frame.depth_m > 0, frame.depth_m, np.nan), cmap="viridis")
    figure.colorbar(shown, ax=depth, shrink=0.8, label="metres")
    ids.imshow(np.where(frame.instance_ids > 0, frame.instance_ids % 20, np.nan), cmap="tab20", interpolation="nearest")
    for axes, title in ((colour, "colour"), (depth, "planar depth"), (ids, "object ids")):
        axes.set_title(title)
        axes.set_axis_off()
    storey = storey_map(scene.navigation, int(nearest_storey(y, scene.navigation.storey_heights)))
    draw_free_floor(above, storey.free, storey.grid)
    here = same_storey(way[:, 1], storey.floor_y)
    above.plot(way[here, 0], way[here, 2], color="#d6006e", linewidth=2)
    above.plot(x, z, marker="o", color="#1f5fa8")
    above.set(title="free space and shortest path", xlabel="x (m)", ylabel="z (m)")
    figure.suptitle(scene.label, fontsize=9)
    figure.savefig(PICTURES / "simulator.png")


def _walk_to_the_goal(page: Page, study: ServedStudy, way: Path) -> None:
    """The PAN screen after five steps; then the script walks on to the goal, whose way an agent knows, and stops."""
    keys = ["d", "a", *(_KEYS[step.action] for step in read_run(way).episodes[0].steps[:-1])]
    page.goto(study.link("pan"))
    press(page, "Start")
    walk(page, keys[:5])
    page.screenshot(path=PICTURES / "study-pan.png")
    walk(page, keys[5:], first=5)
    page.keyboard.press("Enter", delay=60)
    page.keyboard.press("Enter", delay=60)
    expect(page.get_by_text("Saved")).to_be_visible()


def _point_at_the_sofa(page: Page, study: ServedStudy) -> None:
    page.goto(study.link("pog"))
    press(page, "Start")
    point(page, 0.45, 0.33)
    page.screenshot(path=PICTURES / "study-pog.png")


def _compare(folder: Path, dataset: Path, key: EpisodeKey) -> None:
    """The participant's trial beside an exploring agent in Rerun, and the page of `compare` with more agents."""
    work("study", "export", str(folder / "demo/study"), "--out", str(folder / "people"))
    people = sorted(path for path in (folder / "people").iterdir() if (path / "steps.jsonl").is_file())
    explorer = run_agent(_EXPLORER, dataset, folder / "one", "--episode", str(key))
    rrd, page = folder / "pair.rrd", folder / "page"
    data = ["--dataset", str(dataset)]
    work("replay", *data, "--episode", str(key), "--out", str(rrd), "--runs", *map(str, (*people, explorer)))
    screenshot_rrd(rrd, PICTURES / "replay.png", at_end=True)
    agents = [
        run_agent(agent, dataset, folder / "all", "--split", key.split)
        for agent in (_EXPLORER, "random", "shortest-path")
    ]
    work("compare", *map(str, (*people, *agents)), *data, "--out", str(page))
    with open_chromium(width=1600, height=1000) as browser:
        tab = browser.new_page()
        tab.goto((page / "index.html").as_uri())
        tab.wait_for_function("[...document.images].slice(0, 3).every((image) => image.naturalWidth > 0)")
        tab.screenshot(path=PICTURES / "compare.png")


if __name__ == "__main__":
    main()
