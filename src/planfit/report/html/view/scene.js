// Decodes the scene that `planfit.report.scene` wrote into the page.
const bytesOf = (base64) => Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
const floatsOf = (base64) => new Float32Array(bytesOf(base64).buffer);

function readScene() {
  const scene = JSON.parse(document.getElementById("view-scene").textContent);
  for (const name of ["before", "after", "tiles"]) scene[name] = floatsOf(scene[name]);
  const columns = Object.entries(scene.frames);
  const at = (values, i) => values[values.length === 1 ? 0 : i]; // one value where all are the same
  const frameOf = (_, i) => Object.fromEntries(columns.map(([name, values]) => [name, at(values, i)]));
  scene.frames = scene.frames.id.map(frameOf);
  return scene;
}

async function inflate(base64) {
  const packed = new Blob([bytesOf(base64)]).stream();
  return new Response(packed.pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
}

// One level of detail: points of all frames, thinned evenly. Bytes are planes of differences from point to
// point: low and high bytes of x, y, z; red, green, blue; then distances to the plan as they are.
async function readLevel(scene, block) {
  const buffer = await inflate(block.textContent);
  const counts = new Uint32Array(buffer, 0, scene.frames.length);
  const planes = new Uint8Array(buffer, 4 * counts.length);
  const n = counts.reduce((sum, count) => sum + count, 0);
  const points = new Uint16Array(4 * n); // x, y, z, frame
  const looks = new Uint8Array(8 * n); // red, green, blue, -, distance before, distance after, -, -
  for (let axis = 0; axis < 3; axis++) {
    const [low, high] = [2 * axis * n, (2 * axis + 1) * n];
    for (let i = 0, sum = 0; i < n; i++) {
      sum = (sum + planes[low + i] + (planes[high + i] << 8)) & 0xffff;
      points[4 * i + axis] = sum;
    }
    const color = (6 + axis) * n;
    for (let i = 0, sum = 0; i < n; i++) {
      sum = (sum + planes[color + i]) & 0xff;
      looks[8 * i + axis] = sum;
    }
  }
  for (let frame = 0, i = 0; frame < counts.length; frame++)
    for (let k = 0; k < counts[frame]; k++, i++) points[4 * i + 3] = frame;
  if (scene.hasDistances)
    for (let side = 0; side < 2; side++)
      for (let i = 0; i < n; i++) looks[8 * i + 4 + side] = planes[(9 + side) * n + i];
  return { n, points, looks };
}

// A point in a camera's axes, m, in the plan; `share` is 0 before and 1 after.
function placed(scene, frame, point, share) {
  const along = (poses) =>
    [0, 1, 2].map((row) => {
      const at = 12 * frame + 4 * row;
      return poses[at] * point[0] + poses[at + 1] * point[1] + poses[at + 2] * point[2] + poses[at + 3];
    });
  const [before, after] = [along(scene.before), along(scene.after)];
  return before.map((v, i) => v + share * (after[i] - v));
}
