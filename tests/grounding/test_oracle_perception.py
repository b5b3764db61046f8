"""Oracle perception: its vectors, and errors that have the stated size, persist as stated and repeat with the seed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grounding.checks import check_image_encoder
from grounding.encoders.hashed import HashedWords
from grounding.maps.oracle_map import object_texts
from grounding.perception.oracle_perception import CLUTTER_TEXTS, OraclePerception, PerceptionOptions, winning_ids
from sim.episodes.dataset import PersonalDataset
from sim.errors import AgentError
from sim.mesh import SceneObject
from sim.types import Camera, Frame

WORDS = HashedWords()
CAPTIONS = {1: "red wooden chair", 2: "large white sofa", 3: "oval mirror", 7: "copper lamp"}


def frame(ids: list[list[int]], *, x: float = 0.0, scale: int = 8, depth: float = 2.0) -> Frame:
    """A picture of square blocks of these ids, `scale` pixels wide, seen from x."""
    blocks = np.kron(np.array(ids), np.ones((scale, scale), int)).astype(np.int32)
    height, width = blocks.shape
    pose = np.eye(4)
    pose[0, 3] = x
    lens = Camera.of_lens(width, height, fx=50.0, fy=50.0, cx=width / 2, cy=height / 2)
    rgb = np.zeros((height, width, 3), np.uint8)
    return Frame(rgb, np.full((height, width), depth, np.float32), pose, lens, blocks)


def perception(captions: dict[int, str] = CAPTIONS, *, home: str = "", **options) -> OraclePerception:
    return OraclePerception(WORDS, captions, options=PerceptionOptions(patch=8, **options), home=home)


def text(words: str) -> np.ndarray:
    return WORDS.encode_texts([words])[0]


def test_a_patch_has_the_vector_of_its_instances_caption() -> None:
    patches = perception().encode_patches([frame([[1, 2, 0], [9, 7, 1]])])[0]
    assert patches.shape == (2, 3, 768)
    assert np.array_equal(patches[0, 0], text("red wooden chair"))
    assert np.array_equal(patches[0, 1], text("large white sofa"))
    assert np.array_equal(patches[1, 1], text("copper lamp"))
    assert np.array_equal(patches[1, 2], patches[0, 0])
    assert not patches[0, 2].any()  # no instance
    assert not patches[1, 0].any()  # an instance without a caption


def test_a_picture_is_the_mean_over_pixels_and_a_patch_has_its_most_frequent_id_or_the_lowest() -> None:
    seen = perception().encode_images([frame([[1, 1, 1], [2, 0, 9]]), frame([[0, 9, 0]])])
    expected = 3 * text("red wooden chair") + text("large white sofa")
    assert np.allclose(seen[0], expected / np.linalg.norm(expected), atol=1e-6)
    assert not seen[1].any()
    ids = np.array([[1, 1, 5, 5], [1, 5, 2, 2], [0, 0, 3, 3], [0, 4, 3, 9]])
    assert winning_ids(ids, patch=2).tolist() == [[1, 2], [0, 3]]
    # 5 columns in patches of about 2 are columns 0-2 and 3-4
    assert winning_ids(np.array([[1, 1, 2, 2, 2]]), patch=2).tolist() == [[1, 2]]
    assert winning_ids(np.array([[6, 6, 6]]), patch=16).tolist() == [[6]]


def test_the_name_gives_the_space_and_the_oracle_and_the_text_encoder_encodes_queries() -> None:
    encoder = perception()
    assert (encoder.name, encoder.dim) == ("hashed-words-768+oracle-perception", 768)
    assert np.array_equal(encoder.encode_texts(["copper lamp"])[0], text("copper lamp"))
    assert encoder.text_encoder is WORDS


NOISY = {"view_noise": 0.1, "object_noise": 0.1, "confusion": 0.4, "background": "clutter", "seed": 3}


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, NOISY])
def test_oracle_perception_keeps_the_contract(options: dict) -> None:
    assert check_image_encoder(perception(**options)) == []
    assert check_image_encoder(OraclePerception(WORDS, {})) == []


def test_the_same_frames_give_the_same_vectors_in_any_batch_and_order() -> None:
    frames = [frame([[1, 2], [0, 9]]), frame([[1, 2], [0, 9]], x=0.5), frame([[3, 7], [2, 2]])]
    together = perception(**NOISY).encode_patches(frames)
    backwards = perception(**NOISY)
    alone = [backwards.encode_patches([item])[0] for item in reversed(frames)][::-1]
    assert np.array_equal(together, np.array(alone))
    assert np.array_equal(
        perception(**NOISY).encode_images(frames)[1], perception(**NOISY).encode_images(frames[1:2])[0]
    )


def test_view_noise_is_the_deviation_of_the_cosine_and_is_drawn_for_each_view_and_patch() -> None:
    encoder, rng = perception(view_noise=0.05), np.random.default_rng(0)
    probe = rng.standard_normal((2000, 768))
    probe /= np.linalg.norm(probe, axis=1, keepdims=True)
    first, second = encoder.encode_patches([frame([[1, 1]]), frame([[1, 1]], x=1.0)])[:, 0]
    vectors = [first[0], first[1], second[0], second[1]]
    exact = text("red wooden chair")
    length = np.sqrt(1 + 768 * 0.05**2)  # length of the noisy vector before it is normalized
    for vector in vectors:
        assert float(np.std(probe @ (vector * length - exact))) == pytest.approx(0.05, rel=0.1)
    errors = np.array(vectors) * length - exact
    errors /= np.linalg.norm(errors, axis=1, keepdims=True)
    assert np.abs((errors @ errors.T)[~np.eye(4, dtype=bool)]).max() < 0.2


def test_view_noise_averages_out_and_object_noise_depends_on_seed_and_home_but_not_on_other_options() -> None:
    views = [frame([[1]], x=float(x)) for x in range(100)]
    of_views = perception(view_noise=0.1).encode_patches(views)[:, 0, 0].mean(axis=0)
    of_objects = perception(object_noise=0.1).encode_patches(views)[:, 0, 0]
    assert float(of_views @ text("red wooden chair") / np.linalg.norm(of_views)) > 0.95
    assert np.array_equal(of_objects[0], of_objects[99])
    assert float(of_objects[0] @ text("red wooden chair")) < 0.5
    one = perception(object_noise=0.1).encode_patches([frame([[1]])])
    assert not np.array_equal(one, perception(object_noise=0.1, seed=1).encode_patches([frame([[1]])]))
    assert not np.array_equal(one, perception(object_noise=0.1, home="HomeTwo").encode_patches([frame([[1]])]))
    assert np.array_equal(one, perception(object_noise=0.1, background="clutter").encode_patches([frame([[1]])]))


def test_a_confused_instance_has_one_other_text_of_the_home_if_there_is_one() -> None:
    captions = {i: f"thing number{i}" for i in range(1, 401)} | {401: "thing number1"}
    some = perception(captions, confusion=0.2).perceived
    more = perception(captions, confusion=0.5).perceived
    wrong_some = {i for i, words in some.items() if words != captions[i]}
    wrong_more = {i for i, words in more.items() if words != captions[i]}
    assert 55 <= len(wrong_some) <= 105  # 80 are expected, with a standard deviation of 8
    assert wrong_some < wrong_more
    assert {some[i] for i in wrong_some} <= set(captions.values())
    assert all(some[i] == more[i] for i in wrong_some)
    everything = perception(captions, confusion=1.0).perceived
    assert all(words != captions[i] for i, words in everything.items())
    assert perception({1: "bed", 2: "bed"}, confusion=1.0).perceived == {1: "bed", 2: "bed"}


def test_clutter_stays_the_same_for_an_instance_and_a_place_and_needs_depth() -> None:
    encoder = perception(background="clutter")
    clutter = WORDS.encode_texts(CLUTTER_TEXTS)
    here, there = encoder.encode_patches([frame([[9, 0, 1]]), frame([[9, 0, 1]], x=40.0)])[:, 0]
    assert np.array_equal(here[2], text("red wooden chair"))
    assert np.array_equal(here[0], there[0])  # the same instance, seen from elsewhere
    for vector in (here[0], here[1], there[1]):
        assert (clutter == vector).all(axis=1).any()
    turned = perception(background="clutter").encode_patches([frame([[0, 0, 0]], x=40.0), frame([[9, 0, 1]])])
    assert np.array_equal(turned[1, 0, 1], here[1])
    far = encoder.encode_patches([frame([[0]], x=float(x)) for x in range(0, 60, 2)])[:, 0, 0]
    assert len(np.unique(far, axis=0)) > 10
    assert not perception(background="clutter").encode_patches([frame([[0]], depth=0.0)]).any()


def test_frames_without_instance_ids_or_of_several_sizes_are_refused() -> None:
    with pytest.raises(AgentError, match="a frame has no instance ids; expected those of the simulator"):
        perception().encode_patches([replace(frame([[1]]), ids=None)])
    with pytest.raises(AgentError, match=r"frames are of sizes \[\(8, 8\), \(8, 16\)\]; expected one"):
        perception().encode_patches([frame([[1]]), frame([[1, 1]])])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"view_noise": -0.1}, "view_noise is -0.1; expected 0 or more"),
        ({"object_noise": float("nan")}, "object_noise is nan; expected 0 or more"),
        ({"confusion": 1.5}, "confusion is 1.5; expected 0 to 1"),
        ({"patch": 0}, "patch is 0; expected at least 1 pixel"),
    ],
)
def test_impossible_options_are_refused(options: dict, message: str) -> None:
    with pytest.raises(AgentError, match=message):
        PerceptionOptions(**options)


class OneScene:
    """The part of a Scene that `texts` needs."""

    name = "HomeOne"

    def __init__(self, names: list[str]) -> None:
        self.objects = tuple(
            SceneObject(number, name, name.rsplit("_", 1)[0], (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
            for number, name in enumerate(names, start=1)
        )


def test_texts_are_captions_or_categories_and_can_be_paraphrased(small_root: Path) -> None:
    scene = OneScene(["sofa_3", "lamp_4", "toy box_77"])
    texts = object_texts(PersonalDataset(small_root), scene)
    assert texts == {1: "small yellow leather sofa", 2: "lamp", 3: "toy box"}
    scene = OneScene(["sofa_3", "lamp_4"])
    dataset = PersonalDataset(small_root)
    assert object_texts(dataset, scene, level=3) == {1: "sofa", 2: "lamp"}
    half = object_texts(dataset, scene, level=2)[1].split()
    assert half[-1] == "sofa"
    assert len(half) == 2
