// The plan from above, in the coordinates at its rim: points are picked on it, and walls.
function planMap(svg, plan) {
  const map = { point: null, before: null, wall: null };
  const corners = [...plan.faces.flat(), ...plan.path];
  if (!corners.length) return map;
  const [xs, ys] = [0, 1].map((k) => corners.map((c) => c[k]));
  const [x0, x1, y0, y1] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  const margin = 0.05 * Math.max(x1 - x0, y1 - y0) || 1;
  // Rows of pixels grow down, as in SVG; metres of a plan grow up.
  const up = plan.is_picture ? 1 : -1;
  const top = plan.is_picture ? y0 : -y1;
  svg.setAttribute("viewBox", [x0 - margin, top - margin, x1 - x0 + 2 * margin, y1 - y0 + 2 * margin].join(" "));
  const made = (name, values) => {
    const element = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const key in values) element.setAttribute(key, values[key]);
    return svg.appendChild(element);
  };
  const lines = plan.faces.map(([[ax, ay], [bx, by]]) => made("line", { x1: ax, y1: up * ay, x2: bx, y2: up * by }));
  made("polyline", { points: plan.path.map(([x, y]) => `${x},${up * y}`).join(" ") });
  const dots = [0, 1].map(() => made("circle", { r: margin / 6, visibility: "hidden" }));
  svg.addEventListener("click", (event) => {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    [map.before, map.point] = [map.point, [at.x, up * at.y].map((v) => Math.round(v * 1000) / 1000)];
    [map.before, map.point].forEach((p, k) => {
      if (!p) return;
      dots[k].setAttribute("cx", p[0]);
      dots[k].setAttribute("cy", up * p[1]);
      dots[k].setAttribute("visibility", "visible");
    });
    let [best, least] = [null, margin / 2];
    plan.faces.forEach(([a, b], i) => {
      const [dx, dy] = [b[0] - a[0], b[1] - a[1]];
      const t = ((map.point[0] - a[0]) * dx + (map.point[1] - a[1]) * dy) / (dx * dx + dy * dy);
      const s = Math.max(0, Math.min(1, t));
      const far = Math.hypot(a[0] + s * dx - map.point[0], a[1] + s * dy - map.point[1]);
      if (far < least) [best, least] = [i, far];
    });
    lines.forEach((line, i) => line.classList.toggle("chosen", i === best));
    map.wall = best === null ? null : plan.faces[best];
  });
  return map;
}
