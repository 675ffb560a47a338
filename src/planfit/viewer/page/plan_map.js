// The plan from above, in the coordinates at its rim: points are picked on it, and walls. A press near a corner
// or a wall is on it. Dragged, it moves; the wheel, once it was pressed, and its buttons zoom.
const CORNER_PX = 10;
const WALL_PX = 7;
const svgMade = (name, values) => {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const key in values) element.setAttribute(key, values[key]);
  return element;
};

function planMap(svg, plan, onPoint) {
  const map = { point: null, before: null, wall: null, marks: [] };
  const corners = [...plan.faces.flat(), ...plan.path];
  Object.assign(map, { zoom() {}, draw() {}, clear() {} });
  if (!corners.length) return map;
  const [xs, ys] = [0, 1].map((k) => corners.map((c) => c[k]));
  const [x0, x1, y0, y1] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  const margin = 0.05 * Math.max(x1 - x0, y1 - y0) || 1;
  // Rows of pixels grow down, as in SVG; metres of a plan grow up.
  const up = plan.is_picture ? 1 : -1;
  const top = plan.is_picture ? y0 : -y1;
  const whole = [x0 - margin, top - margin, x1 - x0 + 2 * margin, y1 - y0 + 2 * margin];
  let box = [...whole];
  const made = (name, values) => svg.appendChild(svgMade(name, values));
  const lines = plan.faces.map(([[ax, ay], [bx, by]]) => made("line", { x1: ax, y1: up * ay, x2: bx, y2: up * by }));
  made("polyline", { points: plan.path.map(([x, y]) => `${x},${up * y}`).join(" ") });
  const over = made("g", {});
  const unitsOfPixel = () => 1 / (svg.getScreenCTM()?.a || 1);
  const inPlan = (event) => {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    return [at.x, up * at.y];
  };
  const shown = () => {
    svg.setAttribute("viewBox", box.join(" "));
    map.draw();
  };

  map.draw = () => {
    const px = unitsOfPixel();
    over.replaceChildren();
    const dot = ([x, y], words, kind) => {
      over.append(svgMade("circle", { cx: x, cy: up * y, r: (words ? 9 : 5) * px, class: kind }));
      const text = svgMade("text", { x, y: up * y + 4 * px, "font-size": 12 * px });
      text.textContent = words;
      over.append(text);
    };
    map.onDraw?.();
    map.marks.forEach(({ rim }, k) => dot(rim, String(k + 1), ""));
    for (const point of [map.before, map.point]) if (point) dot(point, "", "pending");
  };

  map.clear = () => {
    Object.assign(map, { point: null, before: null, wall: null });
    lines.forEach((line) => line.classList.remove("chosen"));
    map.draw();
  };

  map.zoom = (factor, at = map.point ?? [box[0] + box[2] / 2, up * (box[1] + box[3] / 2)]) => {
    const most = whole[2] / box[2];
    const by = Math.min(Math.max(factor, 0.02 / most), most);
    const centre = [at[0], up * at[1]];
    box = [0, 1].map((k) => centre[k] + (box[k] - centre[k]) * by).concat([box[2] * by, box[3] * by]);
    if (by >= most) box = [...whole];
    shown();
  };

  // The nearest point of a wall, and the wall.
  const onWall = (p) => {
    let best = { far: Infinity };
    plan.faces.forEach(([a, b], i) => {
      const [dx, dy] = [b[0] - a[0], b[1] - a[1]];
      const t = Math.max(0, Math.min(1, ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / (dx * dx + dy * dy || 1)));
      const at = [a[0] + t * dx, a[1] + t * dy];
      const far = Math.hypot(at[0] - p[0], at[1] - p[1]);
      if (far < best.far) best = { far, at, i };
    });
    return best;
  };

  const press = (p) => {
    const px = unitsOfPixel();
    const corner = plan.faces.flat().reduce((best, c) => {
      const far = Math.hypot(c[0] - p[0], c[1] - p[1]);
      return far < best.far ? { far, at: c } : best;
    }, { far: Infinity });
    const wall = onWall(p);
    const isCorner = corner.far < CORNER_PX * px;
    const at = isCorner ? corner.at : wall.far < WALL_PX * px ? wall.at : p;
    [map.before, map.point] = [map.point, at.map((v) => Math.round(v * 1000) / 1000)];
    const chosen = wall.far < 2 * WALL_PX * px ? wall.i : null;
    lines.forEach((line, i) => line.classList.toggle("chosen", i === chosen));
    map.wall = chosen === null ? null : plan.faces[chosen];
    map.draw();
    onPoint(map.point);
  };

  let from = null;
  let isDrag = false;
  svg.addEventListener("pointerdown", (event) => {
    [from, isDrag] = [[event.clientX, event.clientY], false];
  });
  svg.addEventListener("pointermove", (event) => {
    if (!from || !event.buttons) return;
    const [dx, dy] = [event.clientX - from[0], event.clientY - from[1]];
    if (!isDrag && Math.hypot(dx, dy) < 6) return;
    if (!isDrag) svg.setPointerCapture(event.pointerId);
    isDrag = true;
    const px = unitsOfPixel();
    box = [box[0] - dx * px, box[1] - dy * px, box[2], box[3]];
    from = [event.clientX, event.clientY];
    shown();
  });
  svg.addEventListener("pointerup", () => (from = null));
  svg.addEventListener("click", (event) => {
    if (!isDrag) press(inPlan(event));
  });
  svg.addEventListener("wheel", (event) => {
    if (document.activeElement !== svg && !event.ctrlKey) return;
    event.preventDefault();
    map.zoom(Math.exp(0.0015 * event.deltaY), inPlan(event));
  }, { passive: false });
  Object.assign(map, { up, unitsOfPixel });
  new ResizeObserver(() => map.draw()).observe(svg);
  shown();
  return map;
}
