"""Ownership graphs: the object of the home at each node, the drawing, and the 3-D view."""

import re
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np

from personal_viz.browse.layers import Layers, path_segments, thinned
from personal_viz.browse.object_links import ObjectLink, SceneTexts, object_links
from personal_viz.browse.panel_html import PEOPLE_COLORS, graph_html
from personal_viz.study_app.home.surfaces import box_edges
from sim.episodes.ownership import ownership_graph
from sim.mesh import SceneObject

from ..sim.test_page_style import contrast
from .browse_worlds import CAPTIONS, episode, goal, library

SENTENCES = (
    "Nell owns a red couch under the round window in the hall",
    "Ivo owns a green couch in the music room",
    "Ivo owns a tall brass lamp near the door in the hall",
    "Ivo owns a shoe in the hall",
    "Mo owns a red couch under the round window in the hall",
)
ASKED = episode("1", "couch_1", SENTENCES)
OTHERS = (episode("2", "couch_2", SENTENCES, owner="Ivo"), episode("3", "lamp_3", SENTENCES, owner="Ivo"))


def texts() -> SceneTexts:
    return SceneTexts.from_episodes({name: goal(name) for name in CAPTIONS}, (ASKED, *OTHERS))


def test_targets_are_linked_by_the_dataset_and_others_by_their_captions() -> None:
    links = object_links(ASKED, ownership_graph(ASKED), texts())
    assert [(link.goal, link.is_target) for link in links] == [
        ("couch_1", True),
        ("couch_2", False),
        ("lamp_3", False),
        (None, False),
    ]


def test_a_node_that_fits_two_captions_equally_well_is_not_linked() -> None:
    same = SceneTexts(
        {name: goal(name) for name in ("couch_1", "couch_2", "couch_4")},
        {
            "couch_1": ("a red couch under the round window",),
            "couch_2": ("a green couch beside the piano",),
            "couch_4": ("a green couch beside the piano",),
        },
    )
    links = object_links(ASKED, ownership_graph(ASKED), same)
    assert links[1] == ObjectLink(links[1].node, None)


def test_two_nodes_never_share_an_object() -> None:
    told = episode(
        "1",
        "lamp_3",
        (
            "Nell owns a tall brass lamp near the door in the hall",
            "Ivo owns a red couch under the window in the hall",
            "Ivo owns the red couch under the round window in the loft",
        ),
    )
    links = object_links(told, ownership_graph(told), texts())
    assert [link.goal for link in links] == ["lamp_3", None, None]


SHOWN = library(ASKED, *OTHERS).read(0)


def test_the_drawing_has_a_node_per_person_and_object_and_an_edge_per_thing_owned() -> None:
    drawing = graph_html(SHOWN)
    assert re.findall(r'data-node="(\w+)"', drawing) == ["p0", "p1", "p2", "o0", "o1", "o2", "o3"]
    assert re.findall(r'data-ends="([^"]+)"', drawing) == ["p0 o0", "p1 o1", "p1 o2", "p1 o3", "p2 o0"]
    assert 'data-click="object 2"' in drawing
    assert 'data-click="object 3"' not in drawing, "no place to go to"
    assert drawing.count("guess") == 1
    assert "4 objects: 1 asked for, 2 linked by the words of captions, 1 not linked" in drawing


def test_names_can_be_read_in_every_colour_of_people() -> None:
    assert {color: ratio for color in PEOPLE_COLORS if (ratio := contrast(color, "#ffffff")) < 4.5} == {}


def test_a_marked_object_is_marked_with_its_edges_and_owners() -> None:
    drawing = graph_html(SHOWN, marked=0, notes=["storey 2", "", "", ""])
    marked = re.findall(r'class="[^"]* on[^"]*" data-(?:node|ends)="([^"]+)"', drawing)
    assert marked == ["p0 o0", "p2 o0", "p0", "p2", "o0"]
    assert "(couch_1 · storey 2)" in drawing


def test_names_in_the_drawing_are_escaped() -> None:
    evil = episode("1", "couch_1", ("<b>Nell owns a <script>couch</script> in the hall",), owner="<b>Nell")
    drawing = graph_html(library(evil).read(0))
    assert "<script" not in drawing
    assert "<b>" not in drawing
    assert "&lt;b&gt;Nell" in drawing


def test_an_episode_without_sentences_has_a_note_instead_of_a_drawing() -> None:
    assert "no ownership sentence" in graph_html(library(episode("1", "couch_1", ())).read(0))


def test_a_box_has_twelve_edges_along_the_axes() -> None:
    edges = box_edges((1.0, 2.0, 3.0), (2.0, 4.0, 6.0))
    assert edges.shape == (12, 2, 3)
    lengths = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    assert sorted(lengths.tolist()) == [2.0] * 4 + [4.0] * 4 + [6.0] * 4
    assert edges.reshape(-1, 3).mean(axis=0).tolist() == [1.0, 2.0, 3.0]


def test_a_path_shows_only_moves_on_the_storey() -> None:
    positions = np.array([[0, 0, 0], [0, 0, 0], [1, 0, 0], [2, 1.6, 0], [3, 3, 0], [4, 3, 0]], float)
    ground = path_segments(positions, 0.0, lift=0.1)
    upper = path_segments(positions, 3.0, lift=0.1)
    assert ground[:, :, 0].tolist() == [[0, 1], [1, 2]]
    assert np.allclose(ground[0, :, 1], 0.1)
    assert upper[:, :, 0].tolist() == [[2, 3], [3, 4]]


def test_a_dense_region_is_thinned_to_one_point_per_square() -> None:
    points = np.array([[0.01, 0, 0.01], [0.05, 0, 0.05], [0.25, 0, 0.01]])
    assert thinned(points, 0.2)[:, 0].tolist() == [0.01, 0.25]
    assert thinned(np.zeros((0, 3)), 0.2).shape == (0, 3)


def test_names_over_objects_come_and_go_and_another_storey_replaces_the_home() -> None:
    client, told = MagicMock(), MagicMock()
    sofa = SceneObject(7, "sofa_7", "sofa", (1.0, 0.5, 2.0), (2.0, 1.0, 1.0))
    home: Any = SimpleNamespace(copies=SimpleNamespace(glbs=[b"low", b"high"], objects=lambda _: [sofa]))
    layers = Layers(client, told)
    glb, label = client.scene.add_glb, client.scene.add_label
    layers.show_home(home, 0, names=True)
    layers.show_home(home, 0, names=True)
    assert [call.args[1] for call in label.call_args_list] == ["sofa"]
    layers.show_home(home, 0, names=False)
    assert label.return_value.remove.call_count == 1
    assert [call.args for call in glb.call_args_list] == [("/home", b"low")]
    layers.show_home(home, 1, names=False)
    assert glb.return_value.remove.call_count == 1
    assert [call.args for call in glb.call_args_list] == [("/home", b"low"), ("/home", b"high")]
