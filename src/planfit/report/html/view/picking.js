// What lies under a finger: a camera of the path, or a wall of the plan.
const FRAME_REACH_PX = 16;
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
