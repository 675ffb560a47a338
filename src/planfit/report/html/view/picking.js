// What lies under a finger: a camera of the path, or a wall of the plan.
const FRAME_REACH_PX = 16;
const POINT_REACH_PX = 7;
const WALL_REACH_PX = 12; // of a wall seen from above, which is a line

function pickFrame(scene, clipFromPlan, share, x, y, canvas) {
  let [best, least] = [null, FRAME_REACH_PX];
  for (let i = 0; i < scene.frames.length; i++) {
    const at = project(clipFromPlan, placed(scene, i, [0, 0, 0], share));
    if (!at) continue;
    const away = Math.hypot((at[0] - x) * canvas.clientWidth, (at[1] - y) * canvas.clientHeight);
    if (away < least) [best, least] = [i, away];
  }
  return best;
}

// The nearest wall that a ray goes through.
function pickWall(scene, { eye, along }) {
  let [best, least] = [null, Infinity];
  scene.walls.forEach(({ ends: [x0, y0, x1, y1], heights }, i) => {
    const [wx, wy] = [x1 - x0, y1 - y0];
    const slant = along[0] * wy - along[1] * wx;
    if (Math.abs(slant) < 1e-9) return;
    const distance = ((x0 - eye[0]) * wy - (y0 - eye[1]) * wx) / slant;
    const at = plus(eye, along, distance);
    const share = ((at[0] - x0) * wx + (at[1] - y0) * wy) / (wx * wx + wy * wy);
    const isHit = distance > 0 && share >= 0 && share <= 1 && at[2] >= heights[0] && at[2] <= heights[1];
    if (isHit && distance < least) [best, least] = [i, distance];
  });
  return best;
}

// The point of the cloud that is seen under a finger: of those near it, the nearest to the eye, and of those
// that are as near, the one that lies best. Places of all points are those of the picture, by one matrix a frame.
function pickPoint(scene, levels, orbit, share, cut, x, y, canvas) {
  const clip = orbit.clipFromPlan();
  const { back, eye } = orbit.axes();
  const rows = [0, 1, 3].map((row) => [clip[row], clip[4 + row], clip[8 + row], clip[12 + row]]);
  rows.push([...back.map((v) => -v), dot(back, eye)], [0, 0, 1, 0]); // depth, height
  // Where the press is, and its reach, in the units of clip space; the loop looks at every point of the scan.
  const [px, py] = [2 * x - 1, 1 - 2 * y];
  const [rx, ry] = [canvas.clientWidth, canvas.clientHeight].map((size) => (2 * POINT_REACH_PX) / size);
  const found = [];
  let nearest = Infinity;
  // Every level has points of every frame; of a long scan the matrices would cost more than the points.
  const ofFrame = new Map();
  for (const { n, points } of levels)
    for (let i = 0; i < n;) {
      const frame = points[4 * i + 3];
      let m = ofFrame.get(frame);
      if (!m) ofFrame.set(frame, m = rowsOfSteps(scene, frame, share, rows));
      for (; i < n && points[4 * i + 3] === frame; i++) {
        const a = points[4 * i];
        const b = points[4 * i + 1];
        const c = points[4 * i + 2];
        const w = m[8] * a + m[9] * b + m[10] * c + m[11];
        if (w <= 0) continue;
        const dx = (m[0] * a + m[1] * b + m[2] * c + m[3]) / w - px;
        if (dx > rx || dx < -rx) continue;
        const dy = (m[4] * a + m[5] * b + m[6] * c + m[7]) / w - py;
        const away = (dx * dx) / (rx * rx) + (dy * dy) / (ry * ry);
        if (away > 1 || m[16] * a + m[17] * b + m[18] * c + m[19] > cut) continue;
        const depth = m[12] * a + m[13] * b + m[14] * c + m[15];
        nearest = Math.min(nearest, depth);
        found.push([depth, away, frame, a, b, c]);
      }
    }
  // Noise of depth along the ray is not what chooses between points of one surface.
  const seen = found.filter(([depth]) => depth <= nearest + Math.max(0.1, 0.03 * Math.abs(nearest)));
  if (!seen.length) return null;
  const [, , frame, ...steps] = seen.reduce((a, b) => (b[1] < a[1] ? b : a));
  const tile = scene.tiles.subarray(6 * frame, 6 * frame + 6);
  return { frame, point: steps.map((q, axis) => tile[axis] + tile[3 + axis] * q) };
}

// Rows over the plan as rows over the 16-bit steps of a frame's points.
function rowsOfSteps(scene, frame, share, rows) {
  const tile = scene.tiles.subarray(6 * frame, 6 * frame + 6);
  const origin = placed(scene, frame, [tile[0], tile[1], tile[2]], share);
  const along = [0, 1, 2].map((axis) => {
    const step = [tile[0], tile[1], tile[2]];
    step[axis] += tile[3 + axis];
    return plus(placed(scene, frame, step, share), origin, -1);
  });
  return rows.flatMap(([a, b, c, d]) =>
    [...along, origin].map((p, i) => a * p[0] + b * p[1] + c * p[2] + (i === 3 ? d : 0)));
}

// Seen from above: the nearest camera, or wall, to a point of the plan.
function nearestFrame(scene, x, y, share) {
  let [best, least] = [null, Infinity];
  for (let i = 0; i < scene.frames.length; i++) {
    const at = placed(scene, i, [0, 0, 0], share);
    const away = Math.hypot(at[0] - x, at[1] - y);
    if (away < least) [best, least] = [i, away];
  }
  return best;
}

function nearestWall(scene, x, y, reach) {
  let [best, least] = [null, reach];
  scene.walls.forEach(({ ends: [x0, y0, x1, y1] }, i) => {
    const [wx, wy] = [x1 - x0, y1 - y0];
    const share = Math.max(0, Math.min(1, ((x - x0) * wx + (y - y0) * wy) / (wx * wx + wy * wy)));
    const away = Math.hypot(x - x0 - share * wx, y - y0 - share * wy);
    if (away < least) [best, least] = [i, away];
  });
  return best;
}
