"""Verb `map`: a recording becomes a map file; counts are printed; bad options and plug-ins are named in one line."""

import json
from pathlib import Path

import numpy as np
import pytest

from grounding.checks.room import check_views
from grounding.maps.files import load_memory, read_map_header
from grounding.maps.home_map import ObjectMap
from grounding.methods.free_text import ground
from personal_viz.__main__ import main
from personal_viz.cli.grounding.show_map import ShowMap
from personal_viz.cli.verbs import parse
from sim.errors import AgentError, PersonalVizError, RunFileError
from sim.frames import T_world_glb_zup
from tests.grounding.bags import COLOUR, BagWriter
from tests.grounding.mapped_views import ColourEncoder, write_recording
from tests.grounding.test_robot_bags import T_base_camera, write_odometry, write_pictures
from tests.grounding.test_robot_frames import quat_xyzw_of

FRAMES = [view.frame for view in check_views()][::2]
COLOURS = "tests.grounding.mapped_views:colours"


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    write_recording(tmp_path / "kitchen", FRAMES, up="z")
    (tmp_path / "kitchen/poses/0003.txt").unlink()
    np.savetxt(tmp_path / "kitchen/poses/0004.txt", np.full((4, 4), np.nan))
    return tmp_path / "kitchen"


def run(recording: Path, *more: str) -> int:
    arguments = ["map", "--frames", str(recording), "--up", "z", "--encoder", COLOURS, *more]
    return parse(arguments).run()


def test_a_recording_becomes_a_map_file_with_counts(recording: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "maps/kitchen.npz"
    assert run(recording, "--out", str(out), "--cell", "0.5", "--json") == 0
    document = json.loads(capsys.readouterr().out)
    skipped = {"no pose": 1, "pose not finite": 1}
    assert (document["frames"], document["frames_found"], document["frames_skipped"]) == (10, 12, skipped)
    assert (document["every"], document["continued"], document["things"]) == (1, 0, None)
    assert (document["up"], document["up_confidence"]) == ([0, 0, 1], 1)
    assert document["floor_y"] == pytest.approx(0.0, abs=0.05)
    assert document["frames_per_s"] > 1
    assert not list(out.parent.glob("*.encoded"))
    assert (document["encoder"], document["dim"], document["cell"]) == ("colours", 4, 0.5)
    assert document["written"] == str(out)
    (storey,) = document["storeys"]
    assert storey["floor_y"] == pytest.approx(0.0, abs=0.05)
    memory = load_memory(out, encoder=ColourEncoder())
    assert len(memory.storeys[0].memory.rows) == storey["cells"] > 50
    assert 20 < storey["free_m2"] < 31  # the room has 30 m2
    header = read_map_header(out)
    assert (header.source.scene, header.source.kind) == ("kitchen", "robot")
    assert header.source.builder == "0.5 m cells of patches"
    assert "[0.0, 0.0, 1.0] up in its poses" in header.frame
    assert header.source.recording is not None
    assert header.source.recording.path == str(recording)
    np.testing.assert_allclose(header.source.recording.T_map_recording, T_world_glb_zup, atol=1e-9)
    assert header.source.encoder == COLOURS


def test_things_are_found_without_a_model(recording: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "things.npz"
    assert run(recording, "--out", str(out), "--layout", "objects") == 0
    printed = capsys.readouterr().out
    assert "10 of 12 frames used, objects of depth regions, encoder colours (4-d)" in printed
    assert "skipped, no pose: 1" in printed
    assert f"Written to {out}" in printed
    found = load_memory(out).storeys[0].memory
    assert isinstance(found, ObjectMap)
    red = ColourEncoder().encode_texts(["200 30 30"])[0]
    best = max(found.objects, key=lambda item: float(item.feature @ red))
    assert (best.centre[0], best.centre[2]) == pytest.approx((7.0, -8.0), abs=0.4)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--out", "map.zip"], "--out is 'map.zip'; expected a file that ends in .npz"),
        (["--out", "map.npz", "--cell", "0.3"], "cell is 0.3; expected 1 m divided by a whole number"),
        (["--out", "map.npz", "--batch", "0"], "--batch is 0; expected more than 0"),
        (["--out", "map.npz", "--every", "0"], "--every is 0; expected more than 0"),
        (
            ["--out", "map.npz", "--topics", "color=/x"],
            "--topics is 'color=/x'; expected colour=/topic, depth=/topic, i",
        ),
        (["--out", "map.npz", "--topics", "odom=/x", "odom=/y"], "--topics is 'odom=/y'; .* each at most once"),
        (["--out", "map.npz", "--topics", "odom=/x"], "--topics is given for a folder of pictures, which does not"),
        (
            ["--out", "map.npz", "--base-to-camera", "1,2"],
            r"--base-to-camera is '1,2' \(pose not readable\); expected x,",
        ),
        (["--out", "map.npz", "--base-to-camera", "0,0,0,0,0,0,2"], r"0,2' \(pose not a rotation\); expected x,y,z,qx"),
        (
            ["--out", "map.npz", "--encoder", "none", "--layout", "objects"],
            "'none' with --layout objects, whose things",
        ),
        (
            ["--out", "map.npz", "--encoder", "none", "--device", "cuda"],
            "--device is 'cuda' with --encoder none, which",
        ),
        (["--out", "map.npz", "--encoder", "no.such.module:eye"], "no.such.module:eye: ModuleNotFoundError"),
        (["--out", "map.npz", "--encoder", "hashed"], "'hashed': cannot see"),
        (["--out", "map.npz", "--layout", "objects", "--segmenter", COLOURS], r"found no method segment\(\)"),
        (["--out", "map.npz", "--layout", "objects", "--segmenter", "sam"], "--segmenter is 'sam'; expected your own"),
    ],
)
def test_bad_options_are_named_before_anything_is_written(options, message, recording: Path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises((AgentError, PersonalVizError), match=message):
        run(recording, *options)
    assert not list(tmp_path.glob("map.*"))


def test_a_folder_without_pictures_is_one_line_and_exit_code_1(tmp_path: Path, capsys, monkeypatch) -> None:
    arguments = ["map", "--frames", str(tmp_path), "--up", "y", "--encoder", COLOURS, "--out", str(tmp_path / "a.npz")]
    monkeypatch.setattr("sys.argv", ["personal-viz", *arguments])
    with pytest.raises(SystemExit, match="1"):
        main()
    assert "found no colour picture; expected color/*.jpg" in capsys.readouterr().err


@pytest.mark.parametrize(("option", "value"), [("--device", "cuda"), ("--autocast", "bfloat16")])
def test_options_of_models_are_refused_for_a_plug_in_that_would_ignore_them(
    option: str, value: str, recording: Path, tmp_path: Path
) -> None:
    message = rf"{option} is '{value}' with --encoder {COLOURS}, which runs no model of ours; expected one of clip:"
    with pytest.raises(AgentError, match=message):
        run(recording, "--out", str(tmp_path / "a.npz"), option, value)


def test_the_batch_size_reaches_plug_ins_too(recording: Path, tmp_path: Path) -> None:
    for batch in ("1", "5"):
        assert run(recording, "--out", str(tmp_path / f"{batch}.npz"), "--batch", batch) == 0
    assert (tmp_path / "1.npz").read_bytes() == (tmp_path / "5.npz").read_bytes()


def test_geometry_alone_makes_free_space_and_no_query_is_answered(recording: Path, tmp_path: Path, capsys) -> None:
    full, bare = tmp_path / "full.npz", tmp_path / "bare.npz"
    assert run(recording, "--out", str(full)) == 0
    assert run(recording, "--out", str(bare), "--encoder", "none") == 0
    assert "10 of 12 frames used, geometry alone, " in capsys.readouterr().out
    with_features, without = load_memory(full).storeys[0], load_memory(bare).storeys[0]
    assert (with_features.occupancy.cells == without.occupancy.cells).all()
    assert (len(without.memory.rows), without.memory.encoder) == (0, "none")
    assert without.memory.centre_xz == pytest.approx(with_features.memory.centre_xz, abs=0.2)
    line = "holds geometry alone, made with --encoder none; expected a map with features. Build it again with personal"
    with pytest.raises(AgentError, match=line):
        load_memory(bare, encoder=ColourEncoder())
    with pytest.raises(AgentError, match=line):
        ground(bare, description="", query="200 30 30", encoder=ColourEncoder(), method="qs")
    assert ShowMap(file=bare, out=tmp_path / "bare.rrd").run() == 0


def test_every_nth_frame_is_mapped_and_said(recording: Path, tmp_path: Path, capsys) -> None:
    assert run(recording, "--out", str(tmp_path / "a.npz"), "--every", "3") == 0
    printed = capsys.readouterr().out
    assert "4 of 12 frames used (--every 3), 1 m cells of patches, encoder colours (4-d), " in printed
    assert "frames/s" in printed


class StopsOnce(ColourEncoder):
    """Is interrupted before its third batch; counts the pictures that it encodes."""

    encoded, is_patient = 0, False

    def encode_patches(self, frames):
        if not StopsOnce.is_patient and StopsOnce.encoded >= 4:
            StopsOnce.is_patient = True
            raise KeyboardInterrupt
        StopsOnce.encoded += len(frames)
        return super().encode_patches(frames)


def test_an_interrupted_run_continues_and_makes_the_same_map(recording: Path, tmp_path: Path, capsys) -> None:
    out, slow = tmp_path / "map.npz", ("--batch", "2", "--encoder", f"{__name__}:StopsOnce")
    with pytest.raises(KeyboardInterrupt):
        run(recording, "--out", str(out), *slow)
    parts = list((tmp_path / "map.npz.encoded").iterdir())
    assert (len(parts), out.exists()) == (2, False)
    parts[0].write_bytes(b"half")  # a damaged part is encoded again
    assert run(recording, "--out", str(out), *slow) == 0
    assert "encoded by earlier runs: 2" in capsys.readouterr().out
    assert StopsOnce.encoded == 4 + 8
    assert not list(tmp_path.glob("*.encoded"))
    assert run(recording, "--out", str(tmp_path / "whole.npz"), *slow) == 0
    assert out.read_bytes() == (tmp_path / "whole.npz").read_bytes()


def test_shards_encode_and_the_command_without_them_writes_the_same_map(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(StopsOnce, "is_patient", True)
    monkeypatch.setattr(StopsOnce, "encoded", 0)
    out, batches = tmp_path / "map.npz", ("--batch", "2", "--encoder", f"{__name__}:StopsOnce")
    for number, count in ((1, 4), (2, 4), (3, 2)):
        assert run(recording, "--out", str(out), *batches, "--shard", f"{number}/3") == 0
        assert f"Shard {number}/3: {count} pictures encoded, 0 were already." in capsys.readouterr().out
    assert not out.exists()
    assert run(recording, "--out", str(out), *batches) == 0
    assert "encoded by earlier runs: 10" in capsys.readouterr().out
    assert StopsOnce.encoded == 10
    assert run(recording, "--out", str(tmp_path / "whole.npz"), *batches) == 0
    assert out.read_bytes() == (tmp_path / "whole.npz").read_bytes()
    with pytest.raises(
        PersonalVizError,
        match=r"--shard is '1/3' with --encoder 'none'; expected one with encode_patches, .* Leave --shard out",
    ):
        run(recording, "--out", str(out), "--shard", "1/3", "--encoder", "none")


def test_a_mesh_that_cannot_be_written_loses_neither_the_map_nor_what_is_encoded(
    recording: Path, tmp_path: Path, capsys
) -> None:
    out, mesh = tmp_path / "map.npz", tmp_path / "room.glb"
    mesh.mkdir()
    with pytest.raises(PersonalVizError, match=r"room.glb: cannot be written"):
        run(recording, "--out", str(out), "--mesh", str(mesh))
    mapped = out.read_bytes()
    assert list((tmp_path / "map.npz.encoded").iterdir())
    mesh.rmdir()
    assert run(recording, "--out", str(out), "--mesh", str(mesh)) == 0
    printed = capsys.readouterr().out
    assert "encoded by earlier runs: 10" in printed
    assert f"triangles written to {mesh}" in printed
    assert out.read_bytes() == mapped
    assert not list(tmp_path.glob("*.encoded"))


def test_a_folder_that_cannot_keep_what_is_encoded_is_named(recording: Path, tmp_path: Path) -> None:
    (tmp_path / "map.npz.encoded").write_bytes(b"a file")
    with pytest.raises(RunFileError, match=r"map.npz.encoded/.*.npy: cannot be written \(.*\); .* Give another --out"):
        run(recording, "--out", str(tmp_path / "map.npz"))


def test_a_bag_becomes_a_map_named_after_its_file(tmp_path: Path, capsys) -> None:
    bag = BagWriter(tmp_path / "lab.bag")
    write_pictures(bag)
    write_odometry(bag)
    bag.close()
    place, quat = T_base_camera[:3, 3], quat_xyzw_of(T_base_camera[:3, :3])
    given = ",".join(f"{number:.9f}" for number in (*place, *quat))
    arguments = ["--out", str(tmp_path / "a.npz"), f"--base-to-camera={given}", "--topics", f"colour={COLOUR}"]
    assert run(tmp_path / "lab.bag", *arguments) == 0
    assert "8 of 8 frames used" in capsys.readouterr().out
    assert read_map_header(tmp_path / "a.npz").source.scene == "lab"


def test_a_recording_whose_colours_cannot_be_read_says_why(recording: Path, tmp_path: Path) -> None:
    for path in (recording / "color").iterdir():
        path.write_bytes(path.read_bytes()[:-40] if path.suffix == ".png" else b"")
    with pytest.raises(PersonalVizError, match=r"none of 12 pictures can be used: .*picture not readable.*PNG or JPEG"):
        run(recording, "--out", str(tmp_path / "a.npz"))
    assert not (tmp_path / "a.npz").exists()


def test_an_axis_that_begins_with_a_minus_is_a_value(recording: Path) -> None:
    parsed = parse(["map", "--frames", str(recording), "--up", "-y", "--encoder", "none", "--out", "a.npz"])
    assert parsed.up == "-y"  # type: ignore[attr-defined]
    parsed = parse(["map", "--frames", str(recording), "--up", "-0.1,0.9,0", "--encoder", "none", "--out", "a.npz"])
    assert parsed.up == "-0.1,0.9,0"  # type: ignore[attr-defined]
