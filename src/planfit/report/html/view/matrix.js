// 4 x 4 matrices as 16 numbers, column by column as WebGL takes them; vectors are arrays of 3.
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const plus = (a, b, scale = 1) => a.map((v, i) => v + scale * b[i]);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((v) => v / (Math.hypot(...a) || 1));

function product(a, b) {
  const out = new Float32Array(16);
  for (let column = 0; column < 4; column++)
    for (let row = 0; row < 4; row++)
      for (let k = 0; k < 4; k++) out[4 * column + row] += a[4 * k + row] * b[4 * column + k];
  return out;
}

function perspective(heightOverDepth, aspect, near, far) {
  const f = 2 / heightOverDepth;
  const depth = 1 / (near - far);
  return [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) * depth, -1, 0, 0, 2 * far * near * depth, 0];
}

// Without perspective; w is the depth of what the eye is turned to, so that dots are as large as there.
function parallel(height, aspect, depth, far) {
  const f = (2 * depth) / height;
  return [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (-2 * depth) / (far + depth), 0, 0, 0, 0, depth];
}

// From the plan to an eye that looks along -z, y up.
function lookAt(eye, right, up, back) {
  return [
    right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
    -dot(right, eye), -dot(up, eye), -dot(back, eye), 1,
  ];
}

// Where a point of the plan is drawn, as shares of the canvas from its upper left; null behind the eye.
function project(clipFromPlan, p) {
  const m = clipFromPlan;
  const at = (row) => m[row] * p[0] + m[4 + row] * p[1] + m[8 + row] * p[2] + m[12 + row];
  const w = at(3);
  return w <= 0 ? null : [0.5 + (0.5 * at(0)) / w, 0.5 - (0.5 * at(1)) / w, w];
}
