"""Small files that unpack to much, or are nested deeply: one line each, within 2 s and 200 MB."""

import gzip
import io
import json
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from ..sim.gltf_files import plain_square

LIMIT_S, LIMIT_MB = 2.0, 200
READERS = {
    "content": "from sim.episodes.dataset import read_scene_file as read",
    "study": "from human_study.design.study import load_study as read",
    "plan": "from sim.homes.plan import load_plan as read",
    "scene": "from sim.scans.glb import load_glb as read",
    "npz": "from sim.exchange.pose_readers import read_npz_table as read",
    "json": "from sim.exchange.pose_readers import read_json_tables; read = lambda path: list(read_json_tables(path))",
    "map": "from grounding.maps.files import load_memory as read",
    "exploration": "from grounding.agents.exploration import load_exploration as read",
    "run": "from sim.tasks.run_files import read_run as read",
    "recording": "from recordings.read import read_recorded as read",
}
"""Kind of file to the import of its reader."""
DEEP = "[" * 400_000


def packed(unpacked_mb: int) -> bytes:
    """Zeros as gzip, a thousandth of the size; in several members, as gzip allows."""
    member = gzip.compress(bytes(64 << 20))
    return member * (unpacked_mb // 64)


def zipped(**members: bytes) -> bytes:
    """A zip file."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, data in members.items():
            archive.writestr(name.replace("__", "."), data)
    return content.getvalue()


def npy(shape: tuple[int, ...], data: bytes) -> bytes:
    """A `.npy` file that announces this shape of float64."""
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return head.getvalue() + data


def content(**fields: str) -> bytes:
    """A content file with these fields as JSON."""
    usual = {"goals_by_category": "{}", "episodes": "[]"}
    usual |= {"category_to_task_category_id": "{}", "category_to_scene_annotation_category_id": "{}"}
    return gzip.compress(("{" + ",".join(f'"{name}":{text}' for name, text in (usual | fields).items()) + "}").encode())


def message(*fields: bytes) -> bytes:
    """A message with rows, as an .rrd file holds it."""
    data = b"".join(fields)
    return struct.pack("<QQ", 2, len(data)) + data


def chain(num_nodes: int, *, shown: bool = False) -> bytes:
    """Nodes of which each is the child of the next one, with a square in the first or in each."""
    writer = plain_square()
    mesh = {"mesh": 0} if shown else {}
    writer.json["nodes"] = [{"mesh": 0}] + [{"children": [k], **mesh} for k in range(num_nodes - 1)]
    writer.json["scenes"] = [{"nodes": [num_nodes - 1]}]
    return writer.glb()


def aliases(depth: int) -> str:
    """YAML in which each line repeats the one before it nine times."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, depth)]
    return "\n".join(lines)


def bombs() -> dict[str, tuple[str, bytes, str]]:
    """File name to (kind, content, part of the line that refuses it)."""
    zeros = bytes(256 << 20)
    rrd_head = b"RRF2\0\x29\0\0\x01\x02\0\0"
    huge = b"\x18" + b"\xff\xff\xff\xff\x07"  # field 3: 2^31 - 1
    lies = message(b"\x2a\x04abcd" + huge)  # its rows first
    return {
        "packed.json.gz": ("content", packed(4096), "unpacks to more than 32 MB"),
        "members.json.gz": ("content", gzip.compress(b"") * 100_000, "more than 100 gzip members"),
        "cut.json.gz": ("content", content()[:-9], "ends in the middle"),
        "empties.json.gz": ("content", content(episodes="[" + "{}," * 45_000 + "{}]"), "Field required"),
        "goals.json.gz": (
            "content",
            content(goals_by_category="{" + ",".join(f'"{k}":[{{}}]' for k in range(49_000)) + "}"),
            "values that do not fit",
        ),
        "objects.json.gz": ("content", content(episodes="[" + "{}," * 60_000 + "{}]"), "found 60005 JSON objects"),
        "keys.json.gz": ("content", content(**{f"k{k}": "0" for k in range(200_000)}), "values that do not fit"),
        "many.json.gz": ("content", content(episodes="[" + "[]," * 400_000 + "0]"), "more than 250000 values"),
        "deep.json.gz": ("content", gzip.compress(DEEP.encode()), "values"),
        "deeper.json.gz": ("content", gzip.compress(DEEP[:200_000].encode()), "not JSON"),
        "aliases/study.yaml": ("study", aliases(9).encode(), "with what its aliases repeat"),
        "long/study.yaml": ("study", b"a: [" + b"1," * 1_000_000 + b"1]", "more than 128 kB"),
        "deep/study.yaml": ("study", b"a: " + b"[" * 60_000, "nested too deeply"),
        "home.plan.json": ("plan", b'{"rooms":' + DEEP[:300_000].encode(), "not JSON"),
        "chain.glb": ("scene", chain(100_000), "has 100000 nodes; expected at most 65536"),
        "placed.glb": ("scene", chain(60_000, shown=True), "shows more than 8192 primitives"),
        "deep.gltf": ("scene", b'{"asset":{"version":"2.0"},"x":' + DEEP.encode(), "not JSON"),
        "zeros.npz": ("npz", zipped(positions__npy=npy((11_184_810, 3), zeros)), "unpacks to more than 16 MB"),
        "announced.npz": ("npz", zipped(positions__npy=npy((10**9, 3), b"")), "announces (1000000000, 3)"),
        "many.npz": ("npz", zipped(**{f"a{k}__npy": b"" for k in range(5000)}), "has 5000 members"),
        "deep.json": ("json", DEEP.encode(), "is not JSON"),
        "many.json": ("json", b"[" + b"[]," * 3_000_000 + b"0]", "more than 2000000 values"),
        "zeros.map.npz": ("map", zipped(header__json=b"{}", storey0__npy=zeros), "unpacks to more than"),
        "deep.map.npz": ("map", zipped(header__json=DEEP.encode()), "header.json holds more than 250000 values"),
        "deep.exploration.json": ("exploration", DEEP[:200_000].encode(), "not JSON"),
        "deep/run.json": ("run", DEEP[:200_000].encode(), "not JSON"),
        "large/run.json": ("run", b'{"x":[' + b"[]," * 3_000_000 + b"0]}", "more than 250000 values"),
        "announced.rrd": ("recording", rrd_head + lies + struct.pack("<QQ", 0, 0), "unpacks to more than"),
        "fields.rrd": ("recording", rrd_head + message(b"\x08\0" * 500_000), "more fields than any recording"),
    }


READ_ALL = """
import json, resource, sys, time
from pathlib import Path
from sim.errors import PersonalVizError
readers = {}
for kind, line in json.loads(sys.argv[2]).items():
    found = {}
    exec(line, found)
    readers[kind] = found["read"]
def kb(name):
    return int(Path("/proc/self/status").read_text().split(name + ":")[1].split()[0])
results = {}
for path, kind in json.loads(sys.argv[3]).items():
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    before, began = kb("VmRSS"), time.process_time()
    try:
        readers[kind](Path(path))
        line = "was read"
    except PersonalVizError as error:
        line = str(error)
    results[path] = [line, time.process_time() - began, (kb("VmHWM") - before) / 1024]
print(json.dumps(results))
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="only Linux can measure a peak anew")
def test_a_bomb_is_one_line_in_bounded_time_and_memory(tmp_path: Path) -> None:
    expected: dict[str, tuple[str, int]] = {}
    kinds: dict[str, str] = {}
    for name, (kind, data, part) in bombs().items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)
        given = str(path.parent if kind in ("study", "run") else path)
        kinds[given], expected[given] = kind, (part, len(data))
    command = [sys.executable, "-c", READ_ALL, str(tmp_path), json.dumps(READERS), json.dumps(kinds)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr[-3000:]
    problems = []
    for path, (line, seconds, megabytes) in json.loads(run.stdout).items():
        part, size = expected[path]
        is_line = part in line and "\n" not in line and len(line) < 700
        if not is_line or seconds > LIMIT_S or megabytes > LIMIT_MB + size / 2**20:
            problems.append(f"{Path(path).name}: {seconds:.2f} s, {megabytes:.0f} MB, {line[:300]}")
    assert not problems, "\n".join(problems)
