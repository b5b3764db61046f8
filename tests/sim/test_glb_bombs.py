"""Small glTF files that announce huge content, and randomly damaged ones: bounded memory and only known errors."""

import json
import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sim.errors import SceneError
from sim.scans.glb import load_glb

from .gltf_files import DATA, UV, GltfWriter, jpeg, plain_square, png, with_image


def bombs(folder: Path) -> None:
    """Writes small files that announce huge content; each must be refused or read within the limits of the test."""
    text = '{"asset":{"version":"2.0"},%s}'
    (folder / "deep.gltf").write_text(text % ('"x":' + "[" * 1000000 + "]" * 1000000))
    (folder / "objects.gltf").write_text(text % ('"nodes":[' + "{}," * 3000000 + "{}]"))
    (folder / "wrong.gltf").write_text(text % ('"accessors":[' + '{"componentType":"x"},' * 390000 + "{}]"))
    (folder / "numbers.gltf").write_text(text % ('"x":[' + "0," * 20000000 + "0]"))
    writer = GltfWriter()
    primitive = writer.square()
    writer.show(*[primitive] * 20000)
    writer.json["nodes"] = [{"mesh": 0}] * 1000
    writer.json["scenes"] = [{"nodes": list(range(1000))}]
    writer.save(folder / "primitives.glb")
    writer = GltfWriter()
    writer.show(writer.square(points=np.zeros((60000, 3), np.int8)))
    writer.json["nodes"] = [{"mesh": 0}] * 2000
    writer.json["scenes"] = [{"nodes": list(range(2000))}]
    writer.save(folder / "vertices.glb")
    writer = GltfWriter()
    texture = writer.image(png(np.zeros((4096, 4096), np.uint8)))
    tints = [writer.material(texture, [k / 100, 1, 1, 1]) for k in range(100)]
    primitives = [writer.square(uv=UV, material=tint) for tint in tints]
    writer.show(*primitives)
    writer.save(folder / "tints.glb")
    writer = GltfWriter()
    large = png(np.zeros((8192, 8192), np.uint8))
    tints = [writer.material(writer.image(large + bytes([k])), [0.5, 1, 1, 1]) for k in range(4)]
    writer.show(*[writer.square(uv=UV, material=tint) for tint in tints])
    writer.save(folder / "large.glb")
    writer = GltfWriter()
    size = len(jpeg()) + 30_000_000
    writer.view(jpeg() + bytes(30_000_000))
    for k in range(200):
        view = writer.add("bufferViews", {"buffer": 0, "byteLength": size - k})
        writer.add("textures", {"source": writer.add("images", {"bufferView": view})})
    writer.show(*[writer.square(uv=UV, material=writer.material(k)) for k in range(200)])
    writer.save(folder / "images.glb")
    writer = plain_square()
    writer.json["nodes"] = [{"mesh": 0}] + [{"children": [k]} for k in range(100000)]
    writer.json["scenes"] = [{"nodes": [100000]}]
    writer.save(folder / "chain.glb")
    writer = GltfWriter()
    square = writer.square(points=np.zeros((1 << 20, 3), np.int8))
    texture = writer.image(png(np.zeros((4, 4), np.uint8)))
    sparse = {"count": 1, "indices": {"bufferView": 0, "componentType": 5121}, "values": {"bufferView": 0}}
    item = {"componentType": 5126, "count": 1 << 20, "type": "VEC2", "sparse": sparse}
    primitives = []
    for k in range(300):
        attributes = square["attributes"] | {f"TEXCOORD_{k}": writer.add("accessors", item)}
        primitives.append(square | {"attributes": attributes, "material": writer.material(texture, texCoord=k)})
    writer.show(*primitives)
    writer.save(folder / "sparse.glb")


LOAD_ALL = """
import json, resource, sys
from pathlib import Path
from sim.errors import SceneError
from sim.scans.glb import load_glb
resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
def peak_kb():  # not getrusage: there a child inherits the peak of its parent
    return int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])
before = peak_kb()
found = {}
for path in sorted(Path(sys.argv[1]).iterdir()):
    try:
        message = f"{len(load_glb(path).faces)} faces"
    except SceneError as error:
        message = str(error)
    found[path.name] = message
print(json.dumps([found, (peak_kb() - before) / 1024]))
"""


@pytest.mark.slow
@pytest.mark.skipif(
    not Path("/proc/self/status").exists(), reason="only Linux reports the peak memory of the process itself"
)
def test_bombs_are_refused_or_read_in_bounded_memory(tmp_path):
    bombs(tmp_path)
    command = [sys.executable, "-c", LOAD_ALL, str(tmp_path)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=600, check=True)  # ends a file that hangs
    found, megabytes = json.loads(run.stdout)
    expected = {
        "chain.glb": "has 100001 nodes; expected at most 65536",
        "deep.gltf": "is text that is not JSON",
        "images.glb": "the images have",
        "large.glb": "8 faces",
        "numbers.gltf": "has a JSON part of too many values",
        "objects.gltf": "has a JSON part of too many values",
        "primitives.glb": "shows more than 8192 primitives",
        "sparse.glb": "too many sparse elements; expected at most",
        "tints.glb": "textures have",
        "vertices.glb": "vertices and",
        "wrong.gltf": "accessors.0.componentType is 'x'; expected: Input should be a valid integer (and 2 more",
    }
    assert set(found) == set(expected)
    for name, message in found.items():
        assert expected[name] in message, message
        assert "\n" not in message
    assert megabytes < 1500


def test_randomly_damaged_files_are_read_or_refused_in_one_line(tmp_path):
    rng = random.Random(7)
    basis = with_image((DATA / "corners_etc1s.basis").read_bytes())
    basis.json["textures"] = [{"extensions": {"GOOGLE_texture_basis": {"source": 0}}}]
    coloured = GltfWriter()
    coloured.show(coloured.square(colours=np.full((4, 4), 99, np.uint8)), scale=[-1, 1, 1])
    files = [writer.glb() for writer in (plain_square(), with_image(jpeg()), basis, coloured)]
    path = tmp_path / "a.glb"
    refused = read = 0
    for k in range(600):
        data = bytearray(files[k % len(files)])
        for _ in range(rng.choice([1, 1, 2, 8])):
            data[rng.randrange(len(data))] = rng.choice([0, 255, rng.randrange(256)])
        path.write_bytes(data[: rng.randrange(len(data))] if rng.random() < 0.1 else data)
        try:
            mesh = load_glb(path)
        except SceneError as error:
            refused += "\n" not in str(error)
            continue
        read += 1
        assert mesh.faces.max() < len(mesh.vertices)
        assert np.isfinite(mesh.face_uv).all()
        assert mesh.face_texture.max() < len(mesh.textures)
    assert refused + read == 600
    assert min(refused, read) > 50
