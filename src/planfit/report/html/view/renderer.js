// Draws the scene with WebGL 2. Nothing here knows of the page.
const STATUS_COLORS = {
  agrees: [0.0, 0.62, 0.45], moved: [0.67, 0.2, 0.47],
  new: [0.9, 0.62, 0.0], missing: [0.84, 0.37, 0.0], unseen: [0.55, 0.6, 0.65],
};
const PATH_COLOR = [0.48, 0.25, 0.63];
const CHOSEN_COLOR = [0.8, 0.0, 0.55];

function makeProgram(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost())
    throw new Error(gl.getProgramInfoLog(program));
  const places = {};
  for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i++) {
    const { name } = gl.getActiveUniform(program, i);
    places[name] = gl.getUniformLocation(program, name);
  }
  return { program, places };
}

function makeVertices(gl, buffers) {
  const array = gl.createVertexArray();
  gl.bindVertexArray(array);
  const made = buffers.map((data) => {
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    return buffer;
  });
  return { array, made };
}

function makeFloatVertices(gl, sizes, data) {
  const vertices = makeVertices(gl, [data]);
  const stride = 4 * sizes.reduce((a, b) => a + b, 0);
  sizes.forEach((size, i) => {
    gl.enableVertexAttribArray(i);
    gl.vertexAttribPointer(i, size, gl.FLOAT, false, stride, 4 * sizes.slice(0, i).reduce((a, b) => a + b, 0));
  });
  return { ...vertices, n: (4 * data.length) / stride };
}

// Whether two cameras are one dot of the path, before and after.
const DOT_M = 0.05;
function isNear(scene, one, other) {
  return [scene.before, scene.after].every((poses) =>
    Math.hypot(...[3, 7, 11].map((k) => poses[12 * one + k] - poses[12 * other + k])) < DOT_M);
}

// The four edges from a camera to its picture, and the picture's rim, as pairs of points in its axes.
function frustumLines(scene, frame, depth) {
  const [x, y] = scene.frames[frame].tangents.map((t) => t * depth);
  const corners = [[-x, -y, depth], [x, -y, depth], [x, y, depth], [-x, y, depth]];
  return corners.flatMap((c, i) => [[0, 0, 0], c, c, corners[(i + 1) % 4]]).flatMap((c) => [...c, frame]);
}

class Renderer {
  constructor(canvas, scene) {
    this.canvas = canvas;
    this.scene = scene;
    const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, powerPreference: "high-performance" });
    if (!gl) throw new Error("this browser has no WebGL 2");
    this.gl = gl;
    this.prepare();
  }

  prepare() {
    const { gl, scene } = this;
    this.pointsProgram = makeProgram(gl, POINTS_GLSL, COLOR_GLSL);
    this.camerasProgram = makeProgram(gl, CAMERAS_GLSL, COLOR_GLSL);
    this.wallsProgram = makeProgram(gl, WALLS_GLSL, COLOR_GLSL);
    this.levels = [];
    this.uploadFrames();
    const steps = [];
    const centres = [];
    let last = 0; // that was drawn: video has frames a centimetre apart, which are one dot
    scene.frames.forEach((frame, i) => {
      const isEnd = i === scene.frames.length - 1 || scene.frames[i + 1].isAfterGap;
      if (i > 0 && !frame.isAfterGap && !isEnd && isNear(scene, last, i)) return;
      centres.push(0, 0, 0, i);
      if (i > 0 && !frame.isAfterGap) steps.push(0, 0, 0, last, 0, 0, 0, i);
      last = i;
    });
    this.path = makeFloatVertices(gl, [4], new Float32Array(steps));
    this.centres = makeFloatVertices(gl, [4], new Float32Array(centres));
    const keyframes = scene.keyframes.flatMap((frame) => frustumLines(scene, frame, 0.25));
    this.keyframes = makeFloatVertices(gl, [4], new Float32Array(keyframes));
    this.uploadWalls();
    gl.bindVertexArray(null);
  }

  uploadFrames() {
    const { gl, scene } = this;
    const n = scene.frames.length;
    const height = Math.ceil((8 * n) / 2048);
    const texels = new Float32Array(4 * 2048 * height);
    for (let i = 0; i < n; i++) {
      texels.set(scene.before.subarray(12 * i, 12 * i + 12), 32 * i);
      texels.set(scene.after.subarray(12 * i, 12 * i + 12), 32 * i + 12);
      texels.set(scene.tiles.subarray(6 * i, 6 * i + 3), 32 * i + 24);
      texels[32 * i + 27] = scene.frames[i].floor;
      texels.set(scene.tiles.subarray(6 * i + 3, 6 * i + 6), 32 * i + 28);
    }
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, 2048, height, 0, gl.RGBA, gl.FLOAT, texels);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.NEAREST);
  }

  uploadWalls() {
    const [fills, edges] = [[], []];
    for (const { ends, heights, status } of this.scene.walls) {
      const color = STATUS_COLORS[status];
      const [x0, y0, x1, y1] = ends;
      const [a, b] = [[x0, y0, heights[0]], [x1, y1, heights[0]]];
      const [c, d] = [[x1, y1, heights[1]], [x0, y0, heights[1]]];
      for (const p of [a, b, c, a, c, d]) fills.push(...p, ...color);
      for (const p of [a, b, b, c, c, d, d, a]) edges.push(...p, ...color);
    }
    this.fills = makeFloatVertices(this.gl, [3, 3], new Float32Array(fills));
    this.edges = makeFloatVertices(this.gl, [3, 3], new Float32Array(edges));
  }

  addLevel({ n, points, looks }) {
    const { gl } = this;
    const { array, made } = makeVertices(gl, [points, looks]);
    gl.bindBuffer(gl.ARRAY_BUFFER, made[0]);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 4, gl.UNSIGNED_SHORT, false, 8, 0);
    gl.bindBuffer(gl.ARRAY_BUFFER, made[1]);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribPointer(1, 4, gl.UNSIGNED_BYTE, true, 8, 0);
    gl.enableVertexAttribArray(2);
    gl.vertexAttribPointer(2, 2, gl.UNSIGNED_BYTE, true, 8, 4);
    gl.bindVertexArray(null);
    this.levels.push({ n, array });
  }

  resize() {
    const scale = Math.min(window.devicePixelRatio || 1, 2);
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight].map((v) => Math.round(v * scale));
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    this.pixelRatio = scale;
  }

  // `look` is the whole state of what is shown; see main.js.
  draw(look, clipFromPlan, nLevels) {
    const { gl, canvas } = this;
    this.resize();
    gl.disable(gl.SCISSOR_TEST);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(1, 1, 1, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    const split = Math.round(look.wipe * canvas.width);
    const sides = look.isWiped ? [[0, 0, split], [1, split, canvas.width - split]] : [[look.share, 0, canvas.width]];
    gl.enable(gl.SCISSOR_TEST);
    for (const [share, left, width] of sides) {
      gl.scissor(left, 0, width, canvas.height);
      this.drawSide(look, clipFromPlan, share, nLevels);
    }
    gl.disable(gl.SCISSOR_TEST);
    if (look.hasWalls) this.drawWalls(look, clipFromPlan);
  }

  use({ program, places }, clipFromPlan, share) {
    const { gl } = this;
    gl.useProgram(program);
    gl.uniformMatrix4fv(places.u_clip_from_plan, false, clipFromPlan);
    gl.uniform1f(places.u_alpha, 1);
    if (places.u_share) gl.uniform1f(places.u_share, share);
    return places;
  }

  drawSide(look, clipFromPlan, share, nLevels) {
    const { gl, scene, canvas } = this;
    const at = this.use(this.pointsProgram, clipFromPlan, share);
    gl.uniform1i(at.u_coloring, look.coloring);
    gl.uniform2f(at.u_heights, ...scene.heights);
    gl.uniform1f(at.u_cut, look.cut);
    gl.uniform1f(at.u_last_frame, Math.max(scene.frames.length - 1, 1));
    // Fewer points are drawn larger, so that walls do not open while the view turns.
    const count = (levels) => Math.max(levels.reduce((sum, { n }) => sum + n, 0), 1);
    const thinned = Math.min(Math.sqrt(count(this.levels) / count(this.levels.slice(0, nLevels))), 4);
    gl.uniform1f(at.u_size_px, look.pointSize * thinned * canvas.height);
    gl.uniform1f(at.u_frame, look.hasPath ? (look.frame ?? -1) : -1);
    const wall = look.wall === null ? null : scene.walls[look.wall];
    gl.uniform4f(at.u_wall, ...(wall ? wall.ends : [0, 0, 1, 0]));
    gl.uniform3f(at.u_side, ...(wall ? [...wall.normal, 1] : [0, 0, 0]));
    for (const level of this.levels.slice(0, nLevels)) {
      gl.bindVertexArray(level.array);
      gl.drawArrays(gl.POINTS, 0, level.n);
    }
    if (look.hasPath) this.drawCameras(look, clipFromPlan, share);
  }

  drawCameras(look, clipFromPlan, share) {
    const { gl } = this;
    const at = this.use(this.camerasProgram, clipFromPlan, share);
    const lines = (vertices, color, kind = gl.LINES) => {
      gl.uniform3f(at.u_color, ...color);
      gl.bindVertexArray(vertices.array);
      gl.drawArrays(kind, 0, vertices.n);
    };
    gl.uniform1f(at.u_dot_px, 3 * this.pixelRatio);
    lines(this.path, PATH_COLOR);
    lines(this.keyframes, PATH_COLOR);
    lines(this.centres, PATH_COLOR, gl.POINTS);
    if (look.frame === null) return;
    if (this.chosenFrame !== look.frame) {
      if (this.chosen) this.chosen.made.forEach((buffer) => gl.deleteBuffer(buffer));
      const data = [...frustumLines(this.scene, look.frame, 0.7), 0, 0, 0, look.frame];
      this.chosen = makeFloatVertices(gl, [4], new Float32Array(data));
      this.chosenFrame = look.frame;
    }
    gl.disable(gl.DEPTH_TEST); // the chosen frame is seen through walls
    gl.uniform1f(at.u_dot_px, 11 * this.pixelRatio);
    lines(this.chosen, CHOSEN_COLOR);
    gl.drawArrays(gl.POINTS, this.chosen.n - 1, 1);
    gl.enable(gl.DEPTH_TEST);
  }

  drawWalls(look, clipFromPlan) {
    const { gl } = this;
    const at = this.use(this.wallsProgram, clipFromPlan, 0);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    gl.uniform1f(at.u_alpha, 0.13);
    gl.bindVertexArray(this.fills.array);
    gl.drawArrays(gl.TRIANGLES, 0, this.fills.n);
    if (look.wall !== null) {
      gl.uniform1f(at.u_alpha, 0.3);
      gl.drawArrays(gl.TRIANGLES, 6 * look.wall, 6);
    }
    gl.uniform1f(at.u_alpha, 0.85);
    gl.bindVertexArray(this.edges.array);
    gl.drawArrays(gl.LINES, 0, this.edges.n);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
    gl.bindVertexArray(null);
  }
}
