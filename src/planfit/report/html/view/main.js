// Ties the view together: what is shown, the controls, and drawing when something changed.
const LEGENDS = {
  1: (scene) => ["view-ramp-height", ...scene.heights.map((h) => inUnits(h + scene.origin[2], 1))],
  2: () => ["view-ramp-distance", "on the plan", `${inUnits(0.3, 1)} off (grey: no wall near)`],
  3: (scene) => ["view-ramp-time", "first frame", `frame ${scene.frames.length - 1}`],
};

class View {
  constructor(section) {
    this.find = (name) => section.querySelector(`.view-${name}`);
    this.section = section;
    this.canvas = section.querySelector("canvas");
    this.scene = readScene();
    this.scene.wallOfFace = Object.fromEntries(this.scene.walls.map((wall, i) => [wall.face, i]));
    this.look = {
      share: 1, isWiped: false, wipe: 0.5, coloring: 0, hasWalls: true, hasPath: true, cut: this.scene.cut,
      pointSize: 0.022, frame: null, wall: null,
    };
    this.clouds = []; // levels of points, as they came
    // For a page around the report (`planfit view`): what a press on a point does instead of choosing a camera
    // or a wall, and what is done after each picture.
    this.onPoint = null;
    this.onPaint = () => {};
    this.msPerPoint = 1e-4; // found by drawing; begins slow, so that the first turn does not jerk
    this.card = new Card(this.scene, this.find("card"), {
      close: () => this.choose({}),
      chooseFrame: (frame) => this.choose({ frame }),
      lookFrom: (frame) => this.lookFrom(frame),
      show: () => this.section.scrollIntoView({ block: "start" }),
    });
    const choose = { frame: (frame) => this.choose({ frame }), wall: (wall) => this.choose({ wall }) };
    linkNames(this.scene, choose);
    linkPictures(this.scene, choose);
    linkMap(this.scene, choose);
    document.addEventListener("as-built", ({ detail }) => this.judge(detail));
    new IntersectionObserver(
      ([seen]) => this.find("card").classList.toggle("is-away", !seen.isIntersecting), { threshold: 0.3 },
    ).observe(this.find("stage"));
  }

  start() {
    try {
      this.renderer = new Renderer(this.canvas, this.scene);
    } catch (error) {
      this.note(`The 3D view cannot be shown: ${error.message}. The rest of the page works without it.`);
      this.section.dataset.state = "failed";
      return;
    }
    this.orbit = new Orbit(this.canvas, this.scene.bounds, () => this.changed(true));
    this.listen();
    new ResizeObserver(() => this.changed()).observe(this.canvas);
    this.canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    this.canvas.addEventListener("webglcontextrestored", () => {
      this.renderer.prepare();
      this.load();
    });
    this.load();
  }

  // The first level is on the screen before the page with the others is read.
  async load() {
    let n = 0;
    for (let i = 0; i < this.scene.nLevels; i++) {
      if (i === 1 && document.readyState === "loading")
        await new Promise((done) => document.addEventListener("DOMContentLoaded", done));
      const level = await readLevel(this.scene, document.querySelectorAll("script.view-points")[i]);
      this.renderer.addLevel(level);
      this.clouds[i] = { n: level.n, points: level.points };
      n += level.n;
      // Where drawing is slow, most of the time is kept for unpacking.
      const isLast = i + 1 === this.scene.nLevels;
      if (i === 0 || isLast || performance.now() - this.paintedAt > 4 * this.paintMs) {
        this.changed();
        await new Promise((done) => requestAnimationFrame(() => setTimeout(done)));
      } else await new Promise((done) => setTimeout(done));
      if (i === 0) performance.mark("view-first");
      this.note(!isLast ? `${n.toLocaleString("en")} points, loading \u2026` : "");
    }
    performance.mark("view-whole");
    this.section.dataset.state = "ready";
    this.section.dataset.points = n;
  }

  note(words) {
    this.find("note").textContent = words;
  }

  // While it moves, as many levels are drawn as keep to about 30 frames a second; at rest, all. It is at rest
  // when nothing asked for a movement for a while after a picture was done, however long that one took.
  changed(isMoving = false) {
    if (isMoving) {
      this.isMoving = true;
      clearTimeout(this.settling);
    }
    if (this.isAsked || !this.renderer) return;
    this.isAsked = true;
    requestAnimationFrame(() => this.paint());
  }

  paint() {
    this.isAsked = false;
    const { levels, gl } = this.renderer;
    let [nLevels, nPoints] = [0, 0];
    for (const { n } of levels) {
      if (this.isMoving && nLevels && (nPoints + n) * this.msPerPoint > 30) break;
      nLevels += 1;
      nPoints += n;
    }
    const begin = performance.now();
    this.renderer.draw(this.look, this.orbit.clipFromPlan(), nLevels);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4)); // waits until it is drawn
    this.paintedAt = performance.now();
    this.paintMs = this.paintedAt - begin;
    this.onPaint();
    if (!this.isMoving || !nLevels) return;
    const took = this.paintMs / Math.max(nPoints, 1);
    this.msPerPoint += (took > this.msPerPoint ? 1 : 0.3) * (took - this.msPerPoint);
    clearTimeout(this.settling);
    this.settling = setTimeout(() => {
      this.isMoving = false;
      this.changed();
    }, 200);
  }

  listen() {
    const on = (name, kind, action) => this.find(name)?.addEventListener(kind, (event) => action(event.target));
    for (const radio of this.section.querySelectorAll("input[name=view-side]"))
      radio.addEventListener("change", () => this.showSide(radio.value));
    // Without a plan there is no box for its walls.
    on("wipe", "input", (input) => this.set({ wipe: Number(input.value) }));
    on("color", "change", (select) => this.showColoring(Number(select.value)));
    on("walls", "change", (box) => this.set({ hasWalls: box.checked }));
    on("path", "change", (box) => this.set({ hasPath: box.checked }));
    on("cut", "input", (input) => this.showCut(Number(input.value)));
    on("size", "input", (input) => this.set({ pointSize: Number(input.value) }));
    on("frame", "input", (input) => this.choose({ frame: Number(input.value) }));
    on("whole", "click", () => this.orbit.reset());
    on("above", "click", () => this.orbit.reset(true));
    this.canvas.addEventListener("keydown", (event) => this.key(event));
    let down = null;
    this.canvas.addEventListener("pointerdown", (event) => (down = [event.clientX, event.clientY]));
    this.canvas.addEventListener("click", (event) => {
      const isDrag = down && Math.hypot(event.clientX - down[0], event.clientY - down[1]) > 5;
      if (!isDrag) this.pick(event);
    });
    this.showCut(this.look.cut);
  }

  set(changes) {
    Object.assign(this.look, changes);
    this.changed();
  }

  showSide(side) {
    this.section.querySelector(`input[value=${side}]`).checked = true;
    this.find("wipe").hidden = side !== "wipe";
    this.find("sides").hidden = side !== "wipe";
    this.set({ isWiped: side === "wipe" });
    if (side !== "wipe") this.glide(side === "after" ? 1 : 0);
  }

  // The eye follows points from where they were to where they are.
  glide(share) {
    const isStill = matchMedia("(prefers-reduced-motion: reduce)").matches;
    const [from, begin] = [this.look.share, performance.now()];
    const step = () => {
      const t = isStill ? 1 : Math.min(1, (performance.now() - begin) / 350);
      this.look.share = t === 1 ? share : from + (share - from) * t * t * (3 - 2 * t);
      this.changed(t < 1);
      if (t < 1) this.gliding = requestAnimationFrame(step);
    };
    cancelAnimationFrame(this.gliding);
    step();
  }

  showColoring(coloring) {
    this.find("color").value = coloring;
    const legend = this.find("legend");
    legend.hidden = !LEGENDS[coloring];
    if (LEGENDS[coloring]) {
      const [ramp, low, high] = LEGENDS[coloring](this.scene);
      legend.innerHTML = `<span></span> <span class="view-ramp ${ramp}"></span> <span></span>`;
      [legend.firstChild.textContent, legend.lastChild.textContent] = [low, high];
    }
    this.set({ coloring });
  }

  showCut(cut) {
    const input = this.find("cut");
    input.value = cut;
    const isAll = cut >= Number(input.max) - 1e-6;
    this.find("cut-words").textContent = isAll ? "none" : inUnits(cut + this.scene.origin[2], 1);
    this.set({ cut: isAll ? 1e9 : cut });
  }

  choose({ frame = null, wall = null }) {
    if (frame !== null) {
      this.card.showFrame(frame);
      this.find("frame").value = frame;
    } else if (wall !== null) this.card.showWall(wall);
    else this.card.close();
    this.find("frame-words").textContent = frame === null ? "" : String(frame);
    this.set({ frame, wall });
    if (this.orbit && frame !== null) this.bring(placed(this.scene, frame, [0, 0, 0], 1), 12);
    if (this.orbit && wall !== null) {
      const { ends, heights } = this.scene.walls[wall];
      const length = Math.hypot(ends[2] - ends[0], ends[3] - ends[1]);
      this.bring([(ends[0] + ends[2]) / 2, (ends[1] + ends[3]) / 2, (heights[0] + heights[1]) / 2], 8 + 1.5 * length);
    }
  }

  // Another tolerance was chosen on the page: walls have the verdicts of its table.
  judge(verdicts) {
    for (const wall of this.scene.walls) {
      const found = verdicts.get(String(wall.face));
      if (!found) continue;
      wall.status = found.verdict;
      wall.rows = wall.rows.map(([name, words]) => [name, name === "As built" ? found.words : words]);
    }
    this.renderer?.uploadWalls();
    if (this.look.wall !== null) this.card.showWall(this.look.wall);
    this.changed();
  }

  // Turns to what was chosen elsewhere on the page, or lies outside of what is seen.
  bring(point, distance) {
    const at = project(this.orbit.clipFromPlan(), point);
    const isSeen = at && Math.max(Math.abs(at[0] - 0.5), Math.abs(at[1] - 0.5)) < 0.42;
    if (!isSeen || this.find("card").classList.contains("is-away")) this.orbit.goTo(point, distance);
  }

  lookFrom(frame) {
    const { share } = this.look;
    const [here, ahead] = [[0, 0, 0], [0, 0, 1]].map((p) => placed(this.scene, frame, p, share));
    this.orbit.standAt(here, plus(ahead, here, -1));
    this.find("path").checked = false; // little cameras would stand in the way
    this.set({ hasPath: false });
    this.section.scrollIntoView({ block: "nearest" });
  }

  pick(event) {
    const rim = this.canvas.getBoundingClientRect();
    const [x, y] = [(event.clientX - rim.left) / rim.width, (event.clientY - rim.top) / rim.height];
    const { look, scene, orbit } = this;
    const share = look.isWiped ? Number(x >= look.wipe) : look.share;
    if (this.onPoint) {
      const found = pickPoint(scene, this.clouds, orbit, share, look.cut, x, y, this.canvas);
      return this.onPoint(found);
    }
    const frame = look.hasPath ? pickFrame(scene, orbit.clipFromPlan(), share, x, y, this.canvas) : null;
    const wall = frame === null && look.hasWalls ? this.wallUnder(x, y) : null;
    this.choose({ frame, wall });
  }

  // Where a point of a frame, m in its camera's axes, or a point of the plan, m, is drawn: px from the canvas's
  // upper left; null behind the eye.
  drawnAt(point, frame = null) {
    const { scene, look, orbit, canvas } = this;
    const share = look.isWiped ? 1 : look.share;
    const place = frame === null ? plus(point, scene.origin, -1) : placed(scene, frame, point, share);
    const at = project(orbit.clipFromPlan(), place);
    return at && [at[0] * canvas.clientWidth, at[1] * canvas.clientHeight];
  }

  // The same in the plan, m.
  inPlan(point, frame) {
    return plus(placed(this.scene, frame, point, this.look.isWiped ? 1 : this.look.share), this.scene.origin);
  }

  wallUnder(x, y) {
    const ray = this.orbit.ray(x, y);
    if (!this.orbit.isFlat) return pickWall(this.scene, ray);
    const metresOfPixel = (HEIGHT_OVER_DEPTH * this.orbit.distance) / this.canvas.clientHeight;
    return nearestWall(this.scene, ray.eye[0], ray.eye[1], WALL_REACH_PX * metresOfPixel);
  }

  key(event) {
    const { look, scene } = this;
    const step = (by) => this.choose({ frame: Math.max(0, Math.min(scene.frames.length - 1, (look.frame ?? -by) + by)) });
    const last = this.find("color").options.length;
    const keys = {
      b: () => this.showSide(look.share < 0.5 || look.isWiped ? "after" : "before"),
      w: () => this.showSide(look.isWiped ? "after" : "wipe"),
      c: () => this.find("color").selectedIndex = (this.find("color").selectedIndex + 1) % last,
      ",": () => step(-1),
      ".": () => step(1),
      Escape: () => this.choose({}),
    };
    if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    keys[event.key]();
    if (event.key === "c") this.showColoring(Number(this.find("color").value));
    event.preventDefault();
  }
}

const viewSection = document.getElementById("view");
if (viewSection) {
  viewSection.view = new View(viewSection);
  viewSection.view.start();
}
