"""The compiled loops behind `Raycaster`: rows of pixels, and independent rays.

Rows of pixels are traced and coloured packet by packet in one pass.

A picture is cut into tiles of one packet each (4 x 4, 4 x 2 or 2 x 2 pixels: square tiles trace 5-20 % faster than
16 x 1). The lanes of a packet go through each stage together, which the compiler turns into vector code. Colours are
packed: red + 256 green + 65536 blue.

`view` has four numbers for each of x, y, z: one pixel to the right, one down, the ray of pixel (0, 0) with forward
component 1 (which makes hits planar depths), and the camera's place. They are tuples, so that they stay in registers,
and double, so that rays are rounded once: next to silhouettes the last bit decides.
"""

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from sim.compiled import njit
from sim.mesh import VERTEX_COLOURS

from .embree import INVALID, trace
from .texels import FILTERS

SKY_RGB = (214, 226, 238)
"""Colour of pixels that see nothing (windows, gaps of a scan)."""
TILES = {16: (4, 4), 8: (4, 2), 4: (2, 2)}
"""Columns and rows of a tile by packet width."""
Rows = tuple[int, int]
"""First row of tiles and last + 1."""
View = tuple[tuple[float, ...], ...]
"""Origin and directions of the pixels' rays, see above."""
Sampling = tuple[int, float]
"""Number of the texture filter and focal length^2."""
Picture = tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.int32]]
"""rgb, depth, instance ids, while they are filled."""
_NEAREST, _MIPMAP = FILTERS["nearest"], FILTERS["mipmap"]
_SKY = SKY_RGB[0] | SKY_RGB[1] << 8 | SKY_RGB[2] << 16
_MISS = np.float32(np.inf)
_DARK, _HALF, _BRIGHT = np.float32(0), np.float32(0.5), np.float32(255)


@njit(cache=True, nogil=True, error_model="numpy")
def render_rows(tracer, packets, all_lanes, view, surfaces, sampling, rows, picture):
    """Fills rows of tiles of a picture.

    Args:
        tracer: Addresses of scene, arguments and mask for `trace`.
        packets: One packet that no other call uses.
        all_lanes: One `lanes_dtype` that no other call uses.
        view: `View`.
        surfaces: `Surfaces`.
        sampling: `Sampling`.
        rows: `Rows`.
        picture: `Picture`.
    """
    packet, lanes = packets[0], all_lanes[0]
    # here, not below: each unpacking counts references, which takes time
    records, levels, id_levels, id_uv, light = surfaces
    rgb, depth, instance_ids = picture
    cols, tile_rows = _tile(packet)
    _place_rays(packet, view)
    for row in range(rows[0] * tile_rows, rows[1] * tile_rows, tile_rows):
        for col in range(0, depth.shape[1], cols):
            _aim_rays(packet, view, row, col)
            trace(tracer[0], tracer[1], tracer[2], packets.ctypes.data, len(packet.tfar))
            _meet_surfaces(packet, lanes, records, levels, id_levels, id_uv, sampling)
            _look_up_texels(lanes, sampling)
            if len(light):
                _shade_texels(packet, lanes, light)
            _store_depth(packet, row, col, depth)
            _store_lanes(lanes, row, col, rgb, instance_ids)


@njit(cache=True, nogil=True, error_model="numpy")
def depth_rows(tracer, packets, view, rows, depth):
    """Fills rows of tiles of a depth picture (H, W); arguments as in `render_rows`."""
    packet = packets[0]
    cols, tile_rows = _tile(packet)
    _place_rays(packet, view)
    for row in range(rows[0] * tile_rows, rows[1] * tile_rows, tile_rows):
        for col in range(0, depth.shape[1], cols):
            _aim_rays(packet, view, row, col)
            trace(tracer[0], tracer[1], tracer[2], packets.ctypes.data, len(packet.tfar))
            _store_depth(packet, row, col, depth)


@njit(cache=True, nogil=True, error_model="numpy")
def colour_rows(found, mesh, packets, all_lanes, view, surfaces, sampling, rows, picture):
    """`render_rows` with hits that another library found.

    Args:
        found: Hits of the pixels of these rows alone: range (R, W), face (R, W), weights of corners 1 and 2 (R, W, 2).
        mesh: Vertices (V, 3) and faces (F, 3).
        packets: As in `render_rows`, like all arguments that follow.
    """
    packet, lanes = packets[0], all_lanes[0]
    records, levels, id_levels, id_uv, light = surfaces
    rgb, depth, instance_ids = picture
    cols, tile_rows = _tile(packet)
    for row in range(rows[0] * tile_rows, rows[1] * tile_rows, tile_rows):
        for col in range(0, depth.shape[1], cols):
            _aim_rays(packet, view, row, col)
            _take_hits(packet, row - rows[0] * tile_rows, col, found, mesh)
            _meet_surfaces(packet, lanes, records, levels, id_levels, id_uv, sampling)
            _look_up_texels(lanes, sampling)
            if len(light):
                _shade_texels(packet, lanes, light)
            _store_depth(packet, row, col, depth)
            _store_lanes(lanes, row, col, rgb, instance_ids)


@njit(cache=True, nogil=True, error_model="numpy")
def cast_rays(tracer, packets, rays, range_m, face_ids):
    """Fills range (N,) in lengths of the directions, inf for misses, and face (N,), -1 for misses.

    Args:
        tracer: Addresses of scene, arguments and mask for `trace`.
        packets: One packet that no other call uses.
        rays: (N, 6) origins and directions; those that are not finite or have no direction miss.
        range_m: (N,) to fill.
        face_ids: (N,) to fill.
    """
    packet = packets[0]
    width = len(packet.tfar)
    for first in range(0, len(rays), width):
        for i in range(width):
            ray = rays[min(first + i, len(rays) - 1)]
            packet.org_x[i], packet.org_y[i], packet.org_z[i] = ray[0], ray[1], ray[2]
            packet.dir_x[i], packet.dir_y[i], packet.dir_z[i] = ray[3], ray[4], ray[5]
            length = abs(ray[3]) + abs(ray[4]) + abs(ray[5])
            is_ray = length > 0 and np.isfinite(length + abs(ray[0]) + abs(ray[1]) + abs(ray[2]))
            packet.tfar[i] = np.inf if is_ray else -1.0  # Embree skips rays that end before they start
            packet.geom[i] = INVALID
        trace(tracer[0], tracer[1], tracer[2], packets.ctypes.data, width)
        for i in range(min(width, len(rays) - first)):
            is_hit = packet.geom[i] == 0
            range_m[first + i] = packet.tfar[i] if is_hit else np.float32(np.inf)
            face_ids[first + i] = np.int64(packet.prim[i]) if is_hit else -1


@njit(cache=True, nogil=True, error_model="numpy")
def refine_ranges(origins, directions, vertices, faces, range_m, face_ids):
    """Replaces the ranges of hits by those to the planes of their faces, in double precision; all (N,) or (N, 3)."""
    for i in range(len(origins)):
        if face_ids[i] < 0:
            continue
        corners = faces[face_ids[i]]
        along = from_origin = 0.0
        for k in range(3):
            m, n = (k + 1) % 3, (k + 2) % 3
            a, b, c = vertices[corners[0]], vertices[corners[1]], vertices[corners[2]]
            edge_m, edge_n = np.float64(b[m]) - a[m], np.float64(b[n]) - a[n]
            normal = edge_m * (np.float64(c[n]) - a[n]) - edge_n * (np.float64(c[m]) - a[m])
            along += normal * directions[i, k]
            from_origin += normal * (a[k] - origins[i, k])
        exact = from_origin / along
        if abs(exact - range_m[i]) <= 1e-4 * max(1.0, range_m[i]):  # not where the ray runs along its face
            range_m[i] = exact


def _reader(bits: int) -> Any:
    """A compiled function that reads a number of this many bits at an address, as int64; any alignment."""

    @intrinsic
    def number_at(typingctx, address):
        def generate(context, builder, signature, arguments):
            number = builder.load(builder.inttoptr(arguments[0], ir.IntType(bits).as_pointer()), align=1)
            return number if bits == 64 else builder.zext(number, ir.IntType(64))

        return types.int64(types.int64), generate

    return number_at


def _writer(bits: int) -> Any:
    """A compiled function that writes the lower bits of an int64 at an address; any alignment."""

    @intrinsic
    def put_number(typingctx, address, number):
        def generate(context, builder, signature, arguments):
            pointer = builder.inttoptr(arguments[0], ir.IntType(bits).as_pointer())
            builder.store(builder.trunc(arguments[1], ir.IntType(bits)), pointer, align=1)
            return context.get_dummy_value()

        return types.void(types.int64, types.int64), generate

    return put_number


_byte_at, _word_at, _put_half_word = _reader(8), _reader(64), _writer(32)


@njit(forceinline=True)
def _tile(packet):
    """Columns and rows of a packet's tile, as TILES."""
    cols = 4 if len(packet.u) > 4 else 2
    return cols, len(packet.u) // cols


@njit(forceinline=True)
def direction(axis, x, y):
    """One component of the ray through column `x` and row `y`; `axis` is that of a `View`."""
    return axis[0] * x + axis[1] * y + axis[2]


@njit(forceinline=True)
def _place_rays(packet, view):
    for i in range(len(packet.tfar)):
        packet.org_x[i], packet.org_y[i], packet.org_z[i] = view[0][3], view[1][3], view[2][3]


@njit(forceinline=True)
def _aim_rays(packet, view, row, col):
    """Sends the lanes through the pixels of the tile whose first pixel this is; forgets earlier hits."""
    cols, _ = _tile(packet)
    for i in range(len(packet.tfar)):
        x, y = float(col + i % cols), float(row + i // cols)
        packet.dir_x[i] = direction(view[0], x, y)
        packet.dir_y[i] = direction(view[1], x, y)
        packet.dir_z[i] = direction(view[2], x, y)
        packet.tfar[i] = _MISS
        packet.geom[i] = INVALID


@njit(forceinline=True)
def _meet_surfaces(packet, lanes, records, levels, id_levels, id_uv, sampling):
    """Object ids, and either the colour or the texture and the place on it (`width` 0 = there is none)."""
    for i in range(len(packet.tfar)):
        lanes.width[i] = 0
        if not packet.tfar[i] < _MISS:
            lanes.colour[i], lanes.instance[i] = _SKY, 0
            continue
        face, b, c = packet.prim[i], packet.u[i], packet.v[i]
        record = records[face]
        lanes.instance[i] = record.instance
        if record.id_image >= 0:
            image = id_levels[record.id_image]
            lanes.instance[i] = _id_at(image.address, image.height, image.width, id_uv[face], b, c)
        if record.texture < 0:
            lanes.colour[i] = _face_colour(record, b, c)
            continue
        level = levels[record.texture]
        if sampling[0] == _MIPMAP and level.num_smaller:
            level = levels[_mip_level(packet, i, record, level, sampling[1])]
        lanes.texels[i], lanes.height[i], lanes.width[i] = level.address, level.height, level.width
        lanes.u[i] = record.u0 + b * record.du1 + c * record.du2
        lanes.v[i] = record.v0 + b * record.dv1 + c * record.dv2


@njit(forceinline=True)
def _face_colour(record, b, c):
    """The colour of a face without texture (texels.py tells how records hold it)."""
    first = np.int64(record.u0)
    if record.texture != VERTEX_COLOURS:
        return first
    second, third = np.int64(record.v0), np.int64(record.du1)
    colour = 0
    for k in range(3):
        shift = 8 * k
        mean = (1 - b - c) * (first >> shift & 255) + b * (second >> shift & 255) + c * (third >> shift & 255)
        colour |= np.int64(min(max(mean, 0.0), 255.0) + 0.5) << shift
    return colour


@njit(forceinline=True)
def _id_at(address, height, width, uv, b, c):
    """The object id that an id image shows at a hit of a face with coordinates `uv` (3, 2), without interpolation."""
    u = (1 - b - c) * uv[0, 0] + b * uv[1, 0] + c * uv[2, 0]
    v = (1 - b - c) * uv[0, 1] + b * uv[1, 1] + c * uv[2, 1]
    first = address + 2 * (_within(v, height) * width + _within(u, width))
    return _byte_at(first) | _byte_at(first + 1) << 8


@njit(forceinline=True)
def _mip_level(packet, i, record, level, pixels):
    """Row in `levels` of the size whose texels are nearest to the pixel: half the logarithm of texels per pixel.

    A pixel covers depth^2 / (focal^2 cos) of surface, cos being taken with the ray of forward component 1.
    """
    ng_x, ng_y, ng_z = packet.ng_x[i], packet.ng_y[i], packet.ng_z[i]
    facing = abs(ng_x * packet.dir_x[i] + ng_y * packet.dir_y[i] + ng_z * packet.dir_z[i])
    texels = abs(record.du1 * record.dv2 - record.du2 * record.dv1) * level.height * level.width
    covered = packet.tfar[i] * packet.tfar[i] * texels / (pixels * max(facing, 1e-30))
    if not covered > 2:
        return np.int64(record.texture)
    steps = np.int64(math.floor(0.5 * math.log2(covered) + 0.5))
    return np.int64(level.first_smaller) + min(steps, np.int64(level.num_smaller)) - 1


@njit(forceinline=True)
def _look_up_texels(lanes, sampling):
    if sampling[0] == _NEAREST:
        _nearest_texels(lanes)
    else:
        _weigh_texels(lanes)
        _load_texels(lanes)
        _blend_texels(lanes)


@njit(forceinline=True)
def _weigh_texels(lanes):
    """Byte offsets of the four texels (centres at +0.5) round each lane's place, and the shares of right and bottom."""
    for i in range(len(lanes.u)):
        width, height = lanes.width[i], lanes.height[i]
        x = (lanes.u[i] - np.floor(lanes.u[i])) * np.float32(width) - _HALF
        y = (lanes.v[i] - np.floor(lanes.v[i])) * np.float32(height) - _HALF
        x_floor, y_floor = np.floor(x), np.floor(y)
        lanes.x_share[i], lanes.y_share[i] = x - x_floor, y - y_floor
        left, top = np.int32(x_floor), np.int32(y_floor)
        left = np.int32(width - 1) if left < 0 else left
        top = np.int32(height - 1) if top < 0 else top
        right, bottom = np.int32(left + 1), np.int32(top + 1)
        right = np.int32(0) if right >= width else right
        bottom = np.int32(0) if bottom >= height else bottom
        lanes.left[i], lanes.right[i] = 3 * left, 3 * right
        lanes.top[i], lanes.bottom[i] = 3 * top * width, 3 * bottom * width


@njit(forceinline=True)
def _load_texels(lanes):
    """The four texels, and others in the upper bytes; two reads of eight bytes where these lie within the rows."""
    for i in range(len(lanes.u)):
        if lanes.width[i] == 0:
            continue
        top, bottom = lanes.texels[i] + lanes.top[i], lanes.texels[i] + lanes.bottom[i]
        left, right = lanes.left[i], lanes.right[i]
        if left + 8 <= 3 * lanes.width[i]:  # then `right` follows `left`
            upper, lower = _word_at(top + left), _word_at(bottom + left)
            lanes.top_left[i], lanes.top_right[i] = upper, upper >> 24
            lanes.bottom_left[i], lanes.bottom_right[i] = lower, lower >> 24
        else:
            lanes.top_left[i], lanes.top_right[i] = _rgb_at(top + left), _rgb_at(top + right)
            lanes.bottom_left[i], lanes.bottom_right[i] = _rgb_at(bottom + left), _rgb_at(bottom + right)


@njit(forceinline=True)
def _blend_texels(lanes):
    for i in range(len(lanes.u)):
        blended = _blended(lanes, i, 0) | _blended(lanes, i, 8) << 8 | _blended(lanes, i, 16) << 16
        lanes.colour[i] = lanes.colour[i] if lanes.width[i] == 0 else np.int32(blended)


@njit(forceinline=True)
def _blended(lanes, i, shift):
    """One channel of the weighted texels, as int32."""
    x, y = lanes.x_share[i], lanes.y_share[i]
    upper_left = np.float32(np.int32(lanes.top_left[i] >> shift & 255))
    upper_right = np.float32(np.int32(lanes.top_right[i] >> shift & 255))
    lower_left = np.float32(np.int32(lanes.bottom_left[i] >> shift & 255))
    lower_right = np.float32(np.int32(lanes.bottom_right[i] >> shift & 255))
    upper = upper_left + x * (upper_right - upper_left)
    lower = lower_left + x * (lower_right - lower_left)
    return np.int32(upper + y * (lower - upper) + _HALF)


@njit(forceinline=True)
def _nearest_texels(lanes):
    for i in range(len(lanes.u)):
        if lanes.width[i] == 0:
            continue
        width, height = lanes.width[i], lanes.height[i]
        x, y = _within(lanes.u[i], width), _within(lanes.v[i], height)
        lanes.colour[i] = _rgb_at(lanes.texels[i] + 3 * (y * width + x))


@njit(forceinline=True)
def _shade_texels(packet, lanes, light):
    """Multiplies the colours of textured lanes by the light at their place."""
    for i in range(len(lanes.colour)):
        if lanes.width[i]:
            face = packet.prim[i]
            lanes.light0[i], lanes.light1[i], lanes.light2[i] = light[face, 0], light[face, 1], light[face, 2]
    for i in range(len(lanes.colour)):
        red, green, blue = _shaded(packet, lanes, i, 0), _shaded(packet, lanes, i, 8), _shaded(packet, lanes, i, 16)
        lanes.colour[i] = lanes.colour[i] if lanes.width[i] == 0 else np.int32(red | green << 8 | blue << 16)


@njit(forceinline=True)
def _shaded(packet, lanes, i, shift):
    """One channel of a lane's colour times that of the light, as int32."""
    first = np.float32(np.int32(lanes.light0[i] >> shift & 255))
    second = np.float32(np.int32(lanes.light1[i] >> shift & 255))
    third = np.float32(np.int32(lanes.light2[i] >> shift & 255))
    light = first + packet.u[i] * (second - first) + packet.v[i] * (third - first)
    colour = np.float32(np.int32(lanes.colour[i] >> shift & 255))
    return np.int32(colour * min(max(light, _DARK), _BRIGHT) / _BRIGHT + _HALF)


@njit(forceinline=True)
def _within(coordinate, size):
    """The texel that a repeating coordinate falls into."""
    return max(0, min(np.int64((coordinate - np.floor(coordinate)) * np.float32(size)), np.int64(size - 1)))


@njit(forceinline=True)
def _rgb_at(address):
    """Three bytes in the lower 24 bits."""
    return _byte_at(address) | _byte_at(address + 1) << 8 | _byte_at(address + 2) << 16


@njit(forceinline=True)
def _store_depth(packet, row, col, depth):
    """Puts a tile into the picture; in whole tiles all sizes are known when compiled, which makes vector code."""
    cols, rows = _tile(packet)
    if row + rows <= depth.shape[0] and col + cols <= depth.shape[1]:
        for i in range(len(packet.tfar)):
            depth[row + i // cols, col + i % cols] = packet.tfar[i] if packet.tfar[i] < _MISS else np.float32(0)
        return
    for i in range(len(packet.tfar)):
        if row + i // cols < depth.shape[0] and col + i % cols < depth.shape[1]:
            depth[row + i // cols, col + i % cols] = packet.tfar[i] if packet.tfar[i] < _MISS else np.float32(0)


@njit(forceinline=True)
def _store_lanes(lanes, row, col, rgb, instance_ids):
    """Puts a tile into the picture, as `_store_depth`."""
    cols, rows = _tile(lanes)
    if row + rows <= rgb.shape[0] and col + cols <= rgb.shape[1]:
        for i in range(len(lanes.colour)):
            instance_ids[row + i // cols, col + i % cols] = lanes.instance[i]
        if cols == 4:
            for y in range(rows):
                _store_four_colours(lanes.colour, 4 * y, rgb.ctypes.data + 3 * ((row + y) * rgb.shape[1] + col))
            return
        for i in range(len(lanes.colour)):
            _store_colour(lanes.colour[i], row + i // cols, col + i % cols, rgb)
        return
    for i in range(len(lanes.colour)):
        if row + i // cols < rgb.shape[0] and col + i % cols < rgb.shape[1]:
            instance_ids[row + i // cols, col + i % cols] = lanes.instance[i]
            _store_colour(lanes.colour[i], row + i // cols, col + i % cols, rgb)


@njit(forceinline=True)
def _store_four_colours(colours, first, address):
    """Twelve bytes in three words."""
    a, b = np.int64(colours[first]), np.int64(colours[first + 1])
    c, d = np.int64(colours[first + 2]), np.int64(colours[first + 3])
    _put_half_word(address, a | b << 24)
    _put_half_word(address + 4, b >> 8 | c << 16)
    _put_half_word(address + 8, c >> 16 | d << 8)


@njit(forceinline=True)
def _store_colour(colour, y, x, rgb):
    rgb[y, x, 0] = np.uint8(colour)
    rgb[y, x, 1] = np.uint8(colour >> 8)
    rgb[y, x, 2] = np.uint8(colour >> 16)


@njit(forceinline=True)
def _take_hits(packet, row, col, found, mesh):
    """Puts another library's hits, from this row and column on, into an empty packet."""
    cols, _ = _tile(packet)
    range_m, face_ids, weights = found
    for i in range(len(packet.tfar)):
        y, x = row + i // cols, col + i % cols
        if y < range_m.shape[0] and x < range_m.shape[1] and range_m[y, x] < _MISS:
            packet.tfar[i], packet.prim[i] = range_m[y, x], face_ids[y, x]
            packet.u[i], packet.v[i] = weights[y, x, 0], weights[y, x, 1]
            _store_normal(packet, i, mesh[0], mesh[1][face_ids[y, x]])


@njit(forceinline=True)
def _store_normal(packet, i, vertices, corners):
    """The face's normal as Embree gives it."""
    first = vertices[corners[0]]
    edge, other = vertices[corners[1]] - first, vertices[corners[2]] - first
    packet.ng_x[i] = edge[1] * other[2] - edge[2] * other[1]
    packet.ng_y[i] = edge[2] * other[0] - edge[0] * other[2]
    packet.ng_z[i] = edge[0] * other[1] - edge[1] * other[0]
