// Builds the navmesh of one home with Recast, as Habitat does, and measures shortest paths on it.
//
// node recast.mjs MODULES HOME
//   MODULES  the folder node_modules that holds recast-navigation
//   HOME     a folder with vertices.f32 (x, y, z of each), faces.i32 (three vertices of each) and
//            pairs.f64 (x, y, z of the start and of the end of each pair); world metres, y up
//
// Prints a JSON list with one value per pair: the length of its path in metres, or null if Recast joins no place near
// the start to a place near the end. Run by recast_lab.py.

import { readFileSync } from "node:fs";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";

// habitat-sim's NavMeshSettings for ObjectNav's robot (0.88 m high, radius 0.18 m), lengths in cells of 5 cm by 20 cm
const SETTINGS = {
  cs: 0.05,
  ch: 0.2,
  walkableSlopeAngle: 45,
  walkableHeight: 5,
  walkableClimb: 1,
  walkableRadius: 4,
  maxEdgeLen: 240,
  maxSimplificationError: 1.3,
  minRegionArea: 20,
  mergeRegionArea: 20,
  maxVertsPerPoly: 6,
  detailSampleDist: 6,
  detailSampleMaxError: 1,
};
// A place of the navmesh farther from a point than this is another place (metres, sideways and in height).
const ASIDE = 0.5;
const ABOVE = 1;
// Habitat allows 2048 nodes and 256 polygons; long paths would be cut there.
const MAX_NODES = 65535;
const MAX_POLYGONS = 4096;

function place(query, point) {
  const found = query.findNearestPoly(point, { halfExtents: { x: ASIDE, y: ABOVE, z: ASIDE } });
  if (!found.nearestRef) {
    return null;
  }
  const { x, y, z } = found.nearestPoint;
  const isNear = Math.hypot(x - point.x, z - point.z) <= ASIDE && Math.abs(y - point.y) <= ABOVE;
  return isNear ? found.nearestRef : null;
}

function pathLength(query, start, end) {
  const first = place(query, start);
  const last = place(query, end);
  if (first === null || last === null) {
    return null;
  }
  const { polys } = query.findPath(first, last, start, end, { maxPathPolys: MAX_POLYGONS });
  if (polys.size === 0 || polys.get(polys.size - 1) !== last) {
    return null; // a path to the nearest place that can be reached
  }
  const path = query.findStraightPath(start, end, polys, { maxStraightPathPoints: MAX_POLYGONS });
  const corner = (i) => [0, 1, 2].map((axis) => path.straightPath.get(3 * i + axis));
  let length = 0;
  for (let i = 1; i < path.straightPathCount; i++) {
    const [before, after] = [corner(i - 1), corner(i)];
    length += Math.hypot(...after.map((value, axis) => value - before[axis]));
  }
  return length;
}

const [modules, home] = process.argv.slice(2).map((folder) => resolve(folder));
const load = (file) => import(pathToFileURL(join(modules, "recast-navigation", file)));
const numbers = (name, type) => new type(new Uint8Array(readFileSync(join(home, name))).buffer);

const { init, NavMeshQuery } = await load("index.mjs");
const { generateSoloNavMesh } = await load("generators.mjs");
await init();
const built = generateSoloNavMesh(numbers("vertices.f32", Float32Array), numbers("faces.i32", Int32Array), SETTINGS);
if (!built.success) {
  throw new Error(built.error);
}
const query = new NavMeshQuery(built.navMesh, { maxNodes: MAX_NODES });
const pairs = numbers("pairs.f64", Float64Array);
const lengths = [];
for (let i = 0; i < pairs.length; i += 6) {
  const [x0, y0, z0, x1, y1, z1] = pairs.slice(i, i + 6);
  lengths.push(pathLength(query, { x: x0, y: y0, z: z0 }, { x: x1, y: y1, z: z1 }));
}
console.log(JSON.stringify(lengths));
