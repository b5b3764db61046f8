"""Embree 4 from the pinned `embreex` wheel: scenes through ctypes, ray packets for compiled kernels.

That wheel has no interface for packets, so its library is used directly. The library is a private part of the wheel,
so we pin exact versions and run a self-test.

A kernel traces one packet with `trace(scene, arguments, valid, packet, width)`: the first three are the addresses in
`coherent` or `incoherent` of an `EmbreeScene`, and `packet` is the address of a record of `new_packet(width)`. Values
of constants and the layout of packets are those of Embree 4.4's headers.
"""

import ctypes
import importlib.metadata
import importlib.util
import os
import weakref
from functools import lru_cache
from pathlib import Path
from typing import NoReturn

import llvmlite.binding
import numpy as np
from numba import types
from numpy.typing import NDArray

from sim.compiled import njit
from sim.errors import MissingDependencyError, SceneError

from .renderer import Backend

WHEEL = "4.4.0.post1"
"""The version of `embreex` whose library is known (pyproject.toml pins it)."""
VERSION = 40400
"""The version that the library reports: major * 10000 + minor * 100 + patch."""
WIDTHS = (16, 8, 4)
"""Packet widths, best first."""
_AGAIN = f"Run: pip install --force-reinstall embreex=={WHEEL}"
INVALID = np.uint32(0xFFFFFFFF)
"""Geometry of a ray that hit nothing."""
Tracer = tuple[int, int, int]
"""Addresses of scene, arguments and mask, as `trace` takes them; valid while their `EmbreeScene` lives."""

_PROPERTY_VERSION, _PROPERTY_NATIVE_RAY = 0, {4: 32, 8: 33, 16: 34}
_BUFFER_INDEX, _BUFFER_VERTEX = 0, 1
_FORMAT_UINT3, _FORMAT_FLOAT3 = 0x5003, 0x9003
_TRIANGLES, _ROBUST, _COHERENT, _ALL_FEATURES = 0, 1 << 2, 1 << 16, 0xFFFFFFFF
_POINTER, _INT, _UINT, _SIZE = ctypes.c_void_p, ctypes.c_int, ctypes.c_uint, ctypes.c_size_t
_FUNCTIONS = {
    "rtcNewDevice": (_POINTER, [ctypes.c_char_p]),
    "rtcReleaseDevice": (None, [_POINTER]),
    "rtcGetDeviceProperty": (ctypes.c_ssize_t, [_POINTER, _INT]),
    "rtcGetDeviceError": (_INT, [_POINTER]),
    "rtcNewScene": (_POINTER, [_POINTER]),
    "rtcReleaseScene": (None, [_POINTER]),
    "rtcSetSceneFlags": (None, [_POINTER, _INT]),
    "rtcCommitScene": (None, [_POINTER]),
    "rtcNewGeometry": (_POINTER, [_POINTER, _INT]),
    "rtcReleaseGeometry": (None, [_POINTER]),
    "rtcSetNewGeometryBuffer": (_POINTER, [_POINTER, _INT, _UINT, _INT, _SIZE, _SIZE]),
    "rtcCommitGeometry": (None, [_POINTER]),
    "rtcAttachGeometry": (_UINT, [_POINTER, _POINTER]),
    **{f"rtcIntersect{width}": (None, [_POINTER, _POINTER, _POINTER, _POINTER]) for width in WIDTHS},
}
_TREE = "tri_accel=bvh8.triangle4v"
"""The search tree with eight branches: with the default's four, packets take 15 to 20 % longer. Both leave no gaps
between faces; `triangle4` is another 10 % faster and does."""
INSTRUCTIONS = "PERSONAL_VIZ_ISA"
"""Environment variable with another instruction set for Embree, such as avx2, to measure what older processors do."""
_SYMBOL = "personal_viz_rtcIntersect{}"
"""Our own names for compiled code: Open3D holds another Embree, and the library stays out of the global symbols."""


def intersect_packet(width: int) -> types.ExternalFunction:
    """`rtcIntersect<width>(valid, scene, packet, arguments)`, all addresses, for kernels; works with cached kernels.

    The kernel may run only after `library()`, which an `EmbreeScene` has called.
    """
    return types.ExternalFunction(_SYMBOL.format(width), types.void(types.intp, types.intp, types.intp, types.intp))


_intersect_16, _intersect_8, _intersect_4 = (intersect_packet(width) for width in WIDTHS)


@njit(forceinline=True)
def trace(scene, arguments, valid, packet, width):
    """Finds the first hits of the packet at this address; `width` is 16, 8 or 4 and known when compiled."""
    if width == 16:
        _intersect_16(valid, scene, packet, arguments)
    elif width == 8:
        _intersect_8(valid, scene, packet, arguments)
    else:
        _intersect_4(valid, scene, packet, arguments)


@lru_cache
def packet_dtype(width: int) -> np.dtype:
    """A packet of rays and their hits (RTCRayHit4, 8 or 16); the end is padded to a multiple of 64 bytes.

    `dir` need not have unit length; `tfar` is measured in lengths of `dir`. Where nothing was hit, `geom` is INVALID,
    and `prim`, `u`, `v` are not written. `ng` is the face's normal, as long as twice the face's area.
    """
    ray = ["org_x", "org_y", "org_z", "tnear", "dir_x", "dir_y", "dir_z", "time", "tfar"]
    hit = ["ng_x", "ng_y", "ng_z", "u", "v"]
    fields = [(name, np.float32, (width,)) for name in ray]
    fields += [(name, np.uint32, (width,)) for name in ("mask", "id", "flags")]
    fields += [(name, np.float32, (width,)) for name in hit]
    fields += [(name, np.uint32, (width,)) for name in ("prim", "geom", "instance", "instance_prim", "_pad0", "_pad1")]
    fields += [("_pad2", np.uint32, (width,))]
    return np.dtype(fields)


def new_packet(width: int) -> NDArray[np.void]:
    """(1,) packet at a multiple of 64 bytes as Embree wants; zero except `tfar` (inf), `mask` and `geom`."""
    dtype = packet_dtype(width)
    packet = aligned_bytes(dtype.itemsize).view(dtype)
    packet["tfar"] = np.inf
    packet["mask"] = packet["geom"] = INVALID
    return packet


def aligned_bytes(size: int) -> NDArray[np.uint8]:
    """(size,) zeros at a multiple of 64 bytes."""
    memory = np.zeros(size + 64, np.uint8)
    offset = -memory.ctypes.data % 64
    return memory[offset : offset + size]


def library_path() -> Path:
    """Path of the Embree library in the pinned wheel.

    Raises:
        MissingDependencyError: The wheel is not installed, is another version or holds no such library.
    """
    try:
        found = importlib.metadata.version("embreex")
    except importlib.metadata.PackageNotFoundError:
        found = None
    if found != WHEEL:
        what = "is not installed" if found is None else f"{found} is installed"
        raise MissingDependencyError(f"embreex {what}; expected {WHEEL}. Run: pip install embreex=={WHEEL}")
    spec = importlib.util.find_spec("embreex")
    package = Path((spec and spec.origin) or "embreex").parent
    paths = sorted((package.parent / "embreex.libs").glob("libembree4*"))
    if not paths:
        raise MissingDependencyError(
            f"{package.parent}/embreex.libs holds no libembree4; expected the one of the Linux x86-64 wheel. {_AGAIN}"
        )
    return paths[0]


@lru_cache
def library() -> ctypes.CDLL:
    """Embree with declared functions, known to compiled kernels; loaded at the first call.

    Raises:
        MissingDependencyError: It is missing or has another version.
    """
    path = library_path()
    try:
        embree = ctypes.CDLL(str(path))
        for name, (result, arguments) in _FUNCTIONS.items():
            function = getattr(embree, name)
            function.restype, function.argtypes = result, arguments
    except (OSError, AttributeError) as error:
        raise MissingDependencyError(f"{path} cannot be used: {error}; expected Embree {VERSION}. {_AGAIN}") from error
    for width in WIDTHS:
        address = ctypes.cast(getattr(embree, f"rtcIntersect{width}"), _POINTER).value
        llvmlite.binding.add_symbol(_SYMBOL.format(width), address)
    return embree


class EmbreeScene:
    """The search tree over one mesh. Rays may be traced from several threads at once; freed with the object.

    Tracing works in forked children too, since no thread of Embree takes part in it.
    """

    coherent: Tracer
    """For rays that run side by side."""
    incoherent: Tracer
    """For rays in any direction."""

    def __init__(self, vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> None:
        """Builds the tree over copies of vertices (V, 3), finite metres, and faces (F, 3).

        It takes 0.1-0.3 s for a million faces, on all cores. The robust flag costs 13 % and closes the gaps between
        faces: without it, single pixels look out of a closed house.

        Raises:
            MissingDependencyError: Embree is missing or has another version.
            SceneError: Memory has run out.
        """
        embree = library()
        device = _new_device(embree)
        scene = embree.rtcNewScene(device)
        # not at exit: a thread might still render then, and the memory goes with the process anyway
        weakref.finalize(self, _release, embree, scene, device).atexit = False
        embree.rtcSetSceneFlags(scene, _ROBUST)
        geometry = embree.rtcNewGeometry(device, _TRIANGLES)
        _copy(embree, geometry, (_BUFFER_VERTEX, _FORMAT_FLOAT3), vertices, np.float32)
        _copy(embree, geometry, (_BUFFER_INDEX, _FORMAT_UINT3), faces, np.uint32)
        embree.rtcCommitGeometry(geometry)
        embree.rtcAttachGeometry(scene, geometry)
        embree.rtcReleaseGeometry(geometry)
        embree.rtcCommitScene(scene)
        _check(embree, device, len(faces))
        self._pointed_at = _arguments(_COHERENT), _arguments(0), _all_lanes_valid()
        coherent, incoherent, valid = (array.ctypes.data for array in self._pointed_at)
        self.coherent, self.incoherent = (scene, coherent, valid), (scene, incoherent, valid)

    def __reduce__(self) -> NoReturn:
        """Refuses to be pickled or copied: the addresses mean nothing elsewhere, and a copy would outlive the tree."""
        raise TypeError(
            "renderer: an Embree scene was about to be pickled or copied; expected it to stay where it was made. "
            "Make a Raycaster of the mesh in each process."
        )


def _arguments(flags: int) -> NDArray[np.uint32]:
    """RTCIntersectArguments."""
    arguments = aligned_bytes(64).view(np.uint32)  # flags, feature mask, then null pointers: no context, no callbacks
    arguments[:2] = flags, _ALL_FEATURES
    return arguments


def _all_lanes_valid() -> NDArray[np.int32]:
    """The mask (16,) that lets every ray of a packet be traced."""
    valid = aligned_bytes(64).view(np.int32)
    valid[:] = -1
    return valid


def _new_device(embree: ctypes.CDLL) -> int:
    isa = os.environ.get(INSTRUCTIONS)
    device = embree.rtcNewDevice((f"{_TREE},isa={isa}" if isa else _TREE).encode())
    if not device:
        found = f"Embree's error {embree.rtcGetDeviceError(None)}" + (f" with {INSTRUCTIONS}={isa}" if isa else "")
        raise MissingDependencyError(f"{found}; expected a device. {f'Unset {INSTRUCTIONS}.' if isa else _AGAIN}")
    return device


def _copy(embree: ctypes.CDLL, geometry: int, kind: tuple[int, int], values: NDArray, dtype: type) -> None:
    buffer, element = kind
    address = embree.rtcSetNewGeometryBuffer(geometry, buffer, 0, element, 12, len(values))
    if address:  # otherwise the device holds the error
        memory = np.ctypeslib.as_array((ctypes.c_uint8 * (12 * len(values))).from_address(address))
        memory.view(dtype).reshape(-1, 3)[:] = values


def _check(embree: ctypes.CDLL, device: int, faces: int) -> None:
    code = embree.rtcGetDeviceError(device)
    if code:
        raise SceneError(
            f"renderer: Embree's error {code} for {faces} faces (4 = out of memory); expected none. "
            "Free memory, or take a smaller mesh."
        )


def _release(embree: ctypes.CDLL, scene: int, device: int) -> None:
    embree.rtcReleaseScene(scene)
    embree.rtcReleaseDevice(device)


@lru_cache
def self_test() -> Backend:
    """Traces a packet with one hit and several misses; returns the packet width of this processor.

    Raises:
        MissingDependencyError: Embree is missing, has another version, or answers wrongly.
    """
    embree = library()
    device = _new_device(embree)
    version = embree.rtcGetDeviceProperty(device, _PROPERTY_VERSION)
    native = [width for width in WIDTHS if embree.rtcGetDeviceProperty(device, _PROPERTY_NATIVE_RAY[width])]
    embree.rtcReleaseDevice(device)
    if version != VERSION or not native:
        raise MissingDependencyError(f"Embree {version} with packets of {native} was found; expected {VERSION}.")
    width = native[0]
    scene = EmbreeScene(np.array([[0.0, 0, 2], [4, 0, 2], [0, 4, 2]]), np.array([[0, 1, 2]]))
    packet = new_packet(width)
    packet["dir_x"][0, 1:], packet["dir_z"] = 1.0, 0.5  # all start at 0; the first meets z = 2 at (1, 0.5), others pass
    packet["org_x"], packet["org_y"], packet["org_z"][0, 1:] = 1.0, 0.5, 3.0
    address, arguments, valid = scene.coherent
    getattr(embree, f"rtcIntersect{width}")(valid, address, packet.ctypes.data, arguments)
    first = packet[0]
    found = (first["tfar"][0], first["u"][0], first["v"][0], first["geom"][0], first["prim"][0])
    if not np.allclose(found, (4.0, 0.25, 0.125, 0, 0)) or (first["geom"][1:] != INVALID).any():
        raise MissingDependencyError(f"Embree's self-test gave {found}; expected (4, 0.25, 0.125, 0, 0).")
    return Backend("embree", width, f"Embree {version} passed its self-test with packets of {width} rays.")
