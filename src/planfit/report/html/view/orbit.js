// A camera that turns about a point of the plan, by mouse, fingers and keys.
const HEIGHT_OVER_DEPTH = 0.9; // of what is seen: 48 degrees
const LOWEST = -1.5;
const HIGHEST = 1.55; // rad

class Orbit {
  constructor(canvas, bounds, onMove) {
    Object.assign(this, { canvas, bounds, onMove });
    this.reset();
    this.listen();
  }

  // The whole scan, obliquely from above; `isFromAbove`: as a plan is read, north up.
  reset(isFromAbove = false) {
    const [low, high] = this.bounds;
    this.target = low.map((v, i) => (v + high[i]) / 2);
    this.isFlat = isFromAbove; // as a drawing, without perspective
    [this.yaw, this.pitch] = isFromAbove ? [-Math.PI / 2, Math.PI / 2] : [-Math.PI / 2 - 0.45, 0.85];
    this.distance = this.distanceToSee();
    this.onMove();
  }

  // From where the whole box is just within the picture, with a margin.
  distanceToSee() {
    const { back, right, up } = this.axes();
    const aspect = this.canvas.clientWidth / Math.max(this.canvas.clientHeight, 1) || 1;
    let most = 2;
    for (let k = 0; k < 8; k++) {
      const from = this.target.map((v, i) => this.bounds[(k >> i) & 1][i] - v);
      const wide = Math.max(Math.abs(dot(from, right)) / aspect, Math.abs(dot(from, up)));
      most = Math.max(most, (2.2 * wide) / HEIGHT_OVER_DEPTH + (this.isFlat ? 0 : dot(from, back)));
    }
    return most;
  }

  // To where a camera stands, looking as it does.
  standAt(position, forward) {
    this.distance = 2;
    this.isFlat = false;
    this.target = plus(position, forward, 2);
    this.yaw = Math.atan2(-forward[1], -forward[0]);
    this.pitch = Math.max(LOWEST, Math.min(HIGHEST, Math.asin(Math.max(-1, Math.min(1, -forward[2])))));
    this.onMove();
  }

  goTo(target, distance) {
    this.target = [...target];
    this.distance = Math.min(this.distance, distance);
    this.onMove();
  }

  axes() {
    const back = [
      Math.cos(this.pitch) * Math.cos(this.yaw), Math.cos(this.pitch) * Math.sin(this.yaw), Math.sin(this.pitch),
    ];
    const right = [-Math.sin(this.yaw), Math.cos(this.yaw), 0];
    return { back, right, up: cross(back, right), eye: plus(this.target, back, this.distance) };
  }

  clipFromPlan() {
    const { back, right, up, eye } = this.axes();
    const [low, high] = this.bounds;
    const far = this.distance + 2 * Math.hypot(...plus(high, low, -1)) + 10;
    const aspect = this.canvas.clientWidth / Math.max(this.canvas.clientHeight, 1);
    const lens = this.isFlat
      ? parallel(HEIGHT_OVER_DEPTH * this.distance, aspect, this.distance, far)
      : perspective(HEIGHT_OVER_DEPTH, aspect, Math.max(0.05, this.distance / 100), far);
    return product(lens, lookAt(eye, right, up, back));
  }

  // The ray under a point of the canvas, given as shares from its upper left.
  ray(x, y) {
    const { back, right, up, eye } = this.axes();
    const aspect = this.canvas.clientWidth / this.canvas.clientHeight;
    const ahead = back.map((v) => -v);
    const aside = (from, depth) =>
      plus(plus(from, right, (x - 0.5) * HEIGHT_OVER_DEPTH * depth * aspect), up, (0.5 - y) * HEIGHT_OVER_DEPTH * depth);
    if (this.isFlat) return { eye: aside(eye, this.distance), along: ahead };
    return { eye, along: unit(aside(ahead, 1)) };
  }

  turn(dx, dy) {
    this.isFlat = false;
    this.yaw -= dx;
    this.pitch = Math.max(LOWEST, Math.min(HIGHEST, this.pitch + dy));
    this.onMove();
  }

  pan(dx, dy) {
    const { right, up } = this.axes();
    const scale = HEIGHT_OVER_DEPTH * this.distance;
    this.target = plus(plus(this.target, right, -dx * scale), up, dy * scale);
    this.onMove();
  }

  zoom(factor) {
    this.distance = Math.max(0.3, Math.min(2000, this.distance * factor));
    this.onMove();
  }

  listen() {
    const { canvas } = this;
    const fingers = new Map();
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    canvas.addEventListener("pointermove", (event) => {
      const was = fingers.get(event.pointerId);
      if (!was) return;
      const now = [event.clientX, event.clientY];
      const size = canvas.clientHeight;
      const [dx, dy] = [(now[0] - was[0]) / size, (now[1] - was[1]) / size];
      if (fingers.size === 2) {
        const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
        const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
        this.zoom(apart(was) / apart(now));
        this.pan(dx / 2, dy / 2);
      } else if (event.shiftKey || event.buttons & 6) this.pan(dx, dy);
      else this.turn(3 * dx, 3 * dy);
      fingers.set(event.pointerId, now);
    });
    for (const kind of ["pointerup", "pointercancel"])
      canvas.addEventListener(kind, (event) => fingers.delete(event.pointerId));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    // The wheel scrolls the page until the view was chosen by a click or the Tab key.
    canvas.addEventListener("wheel", (event) => {
      if (document.activeElement !== canvas && !event.ctrlKey) return;
      event.preventDefault();
      this.zoom(Math.exp(0.0015 * event.deltaY));
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => this.key(event));
  }

  key(event) {
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const arrow = arrows[event.key];
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (arrow) event.shiftKey ? this.pan(-0.06 * arrow[0], -0.06 * arrow[1]) : this.turn(0.1 * arrow[0], -0.1 * arrow[1]);
    else if (event.key === "+" || event.key === "=") this.zoom(0.85);
    else if (event.key === "-") this.zoom(1 / 0.85);
    else if (event.key === "Home") this.reset();
    else return;
    event.preventDefault();
  }
}
